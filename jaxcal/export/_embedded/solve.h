
/* x of m x = y - b: the transposed cofactors of m over its determinant */
static inline void jaxcal_solve(float m[3][3], const float b[3], const float y[3], float x[3]) {
  for (int i = 0; i < 3; ++i) {
    const int c = (i + 1) % 3, d = (i + 2) % 3;
    float sum = 0, determinant = 0;
    for (int j = 0; j < 3; ++j) {
      const int p = (j + 1) % 3, q = (j + 2) % 3;
      const float cofactor = m[p][c] * m[q][d] - m[p][d] * m[q][c];
      sum += cofactor * (y[j] - b[j]);
      determinant += cofactor * m[j][i];
    }
    x[i] = sum / determinant;
  }
}
