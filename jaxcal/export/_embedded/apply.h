static inline void jaxcal_apply(const float m[3][3], const float b[3], const float y[3], float x[3]) {
  for (int i = 0; i < 3; ++i)
    x[i] = m[i][0] * (y[0] - b[0]) + m[i][1] * (y[1] - b[1]) + m[i][2] * (y[2] - b[2]);
}
