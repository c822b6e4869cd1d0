#include <math.h>
#include <string.h>

#ifdef JAXCAL_DOUBLE
#define ROOT sqrt
#define SIZE fabs
#define TINY 1e-14
#else
#define ROOT sqrtf
#define SIZE fabsf
#define TINY 1e-6f
#endif
#define R(x) ((jaxcal_real)(x))

enum { LEAST = 12, MOST_A_BIN = 2000, MONOMIALS = 10, PACKED = 55, ROUNDS = 20 };
static const uint8_t PLAIN[MONOMIALS] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};

/* Place of x^a y^b z^c among the moments: the powers of z of each (a, b) stand in a row. */
static const uint8_t ROW[5][5] = {{0, 5, 9, 12, 14}, {15, 19, 22, 24, 0}, {25, 28, 30, 0, 0}, {31, 33, 0, 0, 0}, {34, 0, 0, 0, 0}};

/* Exponents of the monomials of the quadric x^2, xy, y^2, xz, yz, z^2, x, y, z, 1 (the order of the magnetometer paper). */
static const uint8_t POWER[MONOMIALS][3] = {{2, 0, 0}, {1, 1, 0}, {0, 2, 0}, {1, 0, 1}, {0, 1, 1},
                                            {0, 0, 2}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}};

/* Place of the moment with exponent a along an axis, and b, c along the two that follow it. */
static int place(int axis, int a, int b, int c) {
  if (axis == 0) return ROW[a][b] + c;
  if (axis == 1) return ROW[c][a] + b;
  return ROW[b][c] + a;
}

static int finite3(const jaxcal_real m[3]) {
  return isfinite(m[0]) && isfinite(m[1]) && isfinite(m[2]);
}

/* Moments of u - d along one axis: the binomial theorem, in place (repeated synthetic division). */
static void shift(jaxcal_real s[JAXCAL_MOMENTS], int axis, jaxcal_real d) {
  for (int b = 0; b <= 4; ++b)
    for (int c = 0; b + c <= 4; ++c)
      for (int step = 1; step <= 4 - b - c; ++step) {
        int here = place(axis, 4 - b - c, b, c);
        for (int a = 4 - b - c; a >= step; --a) {
          const int before = place(axis, a - 1, b, c);
          s[here] -= d * s[before];
          here = before;
        }
      }
}

/* One of four steps that move the frame to the mean of the readings along each axis, and scale it to a root mean square of 1: there the
 * sums lose least to rounding. */
static void renew(jaxcal_mag *mag, int step) {
  jaxcal_real size = 0;
  if (step < 3) {
    const jaxcal_real d = mag->sum[place(step, 1, 0, 0)] / mag->sum[0];
    shift(mag->sum, step, d);
    mag->centre[step] += mag->scale * d;
    memset(mag->lost, 0, sizeof mag->lost);
    return;
  }
  for (int axis = 0; axis < 3; ++axis) size += mag->sum[place(axis, 2, 0, 0)];
  size = ROOT(size / mag->sum[0]);
  if (!(size > 0)) return;
  for (int a = 0; a <= 4; ++a)
    for (int b = 0; a + b <= 4; ++b)
      for (int c = 0; a + b + c <= 4; ++c)
        for (int k = 0; k < a + b + c; ++k) mag->sum[ROW[a][b] + c] /= size;
  mag->scale *= size;
  memset(mag->lost, 0, sizeof mag->lost);
}

static void recentre(jaxcal_mag *mag) {
  for (int step = 0; step < 4; ++step) renew(mag, step);
}

void jaxcal_mag_begin(jaxcal_mag *mag) {
  memset(mag, 0, sizeof *mag);
  mag->horizontal = R(0.54);
}

void jaxcal_mag_correct(const jaxcal_mag *mag, const jaxcal_real m[3], jaxcal_real x[3]) {
  const jaxcal_real y[3] = {m[0] - mag->bias[0], m[1] - mag->bias[1], m[2] - mag->bias[2]};
  for (int i = 0; i < 3; ++i) x[i] = mag->matrix[i][0] * y[0] + mag->matrix[i][1] * y[1] + mag->matrix[i][2] * y[2];
}

/* One of 24 directions: the face of the cube, and its quarter. */
static int direction(const jaxcal_real u[3]) {
  int axis = 0;
  for (int i = 1; i < 3; ++i)
    if (SIZE(u[i]) > SIZE(u[axis])) axis = i;
  return 8 * axis + 4 * (u[axis] > 0) + 2 * (u[(axis + 1) % 3] > 0) + (u[(axis + 2) % 3] > 0);
}

int jaxcal_mag_add(jaxcal_mag *mag, const jaxcal_real m[3]) {
  jaxcal_real u[3], power[3][5];
  if (!finite3(m) || mag->count == UINT16_MAX) return 0;
  if (mag->count == 0) {
    memcpy(mag->centre, m, sizeof mag->centre);
    mag->scale = SIZE(m[0]) + SIZE(m[1]) + SIZE(m[2]);
    if (!(mag->scale > 0) || !isfinite(mag->scale)) return 0;
  } else if (m[0] == mag->last[0] && m[1] == mag->last[1] && m[2] == mag->last[2]) {
    if (mag->held < UINT16_MAX) ++mag->held;
    return 0;
  }
  memcpy(mag->last, m, sizeof mag->last);
  for (int i = 0; i < 3; ++i) u[i] = (m[i] - mag->centre[i]) / mag->scale;
  if (!(SIZE(u[0]) + SIZE(u[1]) + SIZE(u[2]) < 100)) return 0; /* no reading of the same field */
  if (mag->solved) {
    jaxcal_real x[3], far;
    jaxcal_mag_correct(mag, m, x);
    far = SIZE(ROOT(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) - mag->field);
    if (!(far <= 6 * mag->noise + mag->field / 20)) {
      if (mag->outliers < UINT16_MAX) ++mag->outliers;
      return 0;
    }
  }
  uint16_t *bin = &mag->bin[direction(u)];
  if (*bin >= MOST_A_BIN) return 0;
  ++*bin;
  ++mag->count;
  for (int i = 0; i < 3; ++i) {
    power[i][0] = 1;
    for (int k = 1; k <= 4; ++k) power[i][k] = power[i][k - 1] * u[i];
  }
  for (int a = 0; a <= 4; ++a)
    for (int b = 0; a + b <= 4; ++b)
      for (int c = 0; a + b + c <= 4; ++c) {
        const int k = ROW[a][b] + c;
        const jaxcal_real add = power[0][a] * power[1][b] * power[2][c] - mag->lost[k], total = mag->sum[k] + add;
        mag->lost[k] = (total - mag->sum[k]) - add;
        mag->sum[k] = total;
      }
  /* four readings share the work, here and later when more is known */
  const int since = mag->count < 64 ? mag->count - 16 : mag->count < 256 ? mag->count - 64 : mag->count - 256;
  if (since >= 0 && since < 4) renew(mag, since);
  return 1;
}

/* Moments over their number without the part of a noise of variance s2: E of the Hermite polynomials is the monomial of the true
 * value (Markovsky, Kukush and Van Huffel, Numer. Math. 98, 2004, 177). */
static void cleaned(const jaxcal_mag *mag, jaxcal_real s2, jaxcal_real s[JAXCAL_MOMENTS]) {
  for (int k = 0; k < JAXCAL_MOMENTS; ++k) s[k] = mag->sum[k] / mag->sum[0];
  for (int axis = 0; axis < 3; ++axis)
    for (int b = 0; b <= 4; ++b)
      for (int c = 0; b + c <= 4; ++c) {
        const int n = 4 - b - c;
        if (n == 4) s[place(axis, 4, b, c)] += s2 * (3 * s2 * s[place(axis, 0, b, c)] - 6 * s[place(axis, 2, b, c)]);
        if (n >= 3) s[place(axis, 3, b, c)] -= 3 * s2 * s[place(axis, 1, b, c)];
        if (n >= 2) s[place(axis, 2, b, c)] -= s2 * s[place(axis, 0, b, c)];
      }
}

/* Place of the product of two monomials among the moments. */
static int product(int i, int j) {
  return ROW[POWER[i][0] + POWER[j][0]][POWER[i][1] + POWER[j][1]] + POWER[i][2] + POWER[j][2];
}

/* Symmetric matrices are packed: the rows of the lower triangle one after the other. */
static int at(int i, int j) {
  return i * (i + 1) / 2 + j;
}

/* Mean of the products of the monomials in this order, with a ridge on the diagonal. */
static void products(const jaxcal_mag *mag, jaxcal_real s2, jaxcal_real ridge, const uint8_t order[MONOMIALS], jaxcal_real psi[PACKED]) {
  jaxcal_real s[JAXCAL_MOMENTS];
  cleaned(mag, s2, s);
  for (int i = 0; i < MONOMIALS; ++i)
    for (int j = 0; j <= i; ++j) psi[at(i, j)] = s[product(order[i], order[j])] + (i == j ? ridge : 0);
}

/* Mean square of the quadric at the readings. */
static jaxcal_real residual(const jaxcal_mag *mag, jaxcal_real s2, const jaxcal_real q[MONOMIALS]) {
  jaxcal_real s[JAXCAL_MOMENTS], total = 0;
  cleaned(mag, s2, s);
  for (int i = 0; i < MONOMIALS; ++i)
    for (int j = 0; j < MONOMIALS; ++j) total += q[i] * s[product(i, j)] * q[j];
  return total;
}

/* Lower Cholesky factor of n rows, in place; 0 if the matrix is not positive definite. */
static int factor(jaxcal_real a[], int n) {
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i) {
      jaxcal_real rest = a[at(i, j)];
      for (int k = 0; k < j; ++k) rest -= a[at(i, k)] * a[at(j, k)];
      if (i == j && !(rest > 0)) return 0;
      a[at(i, j)] = i == j ? ROOT(rest) : rest / a[at(j, j)];
    }
  return 1;
}

static void forward(const jaxcal_real a[], jaxcal_real x[], int n) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= a[at(i, k)] * x[k];
    x[i] /= a[at(i, i)];
  }
}

static void backward(const jaxcal_real a[], jaxcal_real x[], int n) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= a[at(k, i)] * x[k];
    x[i] /= a[at(i, i)];
  }
}

/* Eigenvalues on the diagonal of a, and eigenvectors as columns of v (Jacobi, six sweeps). */
static void eigen(jaxcal_real a[3][3], jaxcal_real v[3][3]) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) v[i][j] = R(i == j);
  for (int sweep = 0; sweep < 6; ++sweep)
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        if (!(SIZE(a[p][q]) > 0)) continue;
        const jaxcal_real half = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        const jaxcal_real t = (half < 0 ? R(-1) : R(1)) / (SIZE(half) + ROOT(half * half + 1));
        const jaxcal_real c = 1 / ROOT(t * t + 1), s = t * c;
        for (int k = 0; k < 3; ++k) {
          const jaxcal_real x = a[k][p], y = a[k][q];
          a[k][p] = c * x - s * y;
          a[k][q] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const jaxcal_real x = a[p][k], y = a[q][k], e = v[k][p], f = v[k][q];
          a[p][k] = c * x - s * y;
          a[q][k] = s * x + c * y;
          v[k][p] = c * e - s * f;
          v[k][q] = s * e + c * f;
        }
      }
}

/* Root W of the shape matrix, |W (u - b)| = 1, and centre b of a quadric; 0 if it is no ellipsoid. */
static int ellipsoid(const jaxcal_real q[MONOMIALS], jaxcal_real w[3][3], jaxcal_real b[3]) {
  jaxcal_real a[3][3] = {{q[0], q[1] / 2, q[3] / 2}, {q[1] / 2, q[2], q[4] / 2}, {q[3] / 2, q[4] / 2, q[5]}};
  jaxcal_real v[3][3], c[3], size = -q[9];
  eigen(a, v);
  for (int i = 0; i < 3; ++i) {
    if (!(SIZE(a[i][i]) > 0)) return 0;
    c[i] = -(v[0][i] * q[6] + v[1][i] * q[7] + v[2][i] * q[8]) / (2 * a[i][i]);
    size += c[i] * c[i] * a[i][i];
  }
  for (int i = 0; i < 3; ++i) {
    b[i] = v[i][0] * c[0] + v[i][1] * c[1] + v[i][2] * c[2];
    if (!(a[i][i] * size > 0) || !(SIZE(b[i]) < 100)) return 0;
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      w[i][j] = 0;
      for (int k = 0; k < 3; ++k) w[i][j] += v[i][k] * v[j][k] * ROOT(a[k][k] / size);
    }
  return 1;
}

/* Determinant of a matrix, and its cofactors, so that the inverse is their transpose over it. */
static jaxcal_real cofactors(jaxcal_real w[3][3], jaxcal_real c[3][3]) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
      c[i][j] = w[i1][j1] * w[i2][j2] - w[i1][j2] * w[i2][j1];
    }
  return w[0][0] * c[0][0] + w[0][1] * c[0][1] + w[0][2] * c[0][2];
}

/* Change of the corrected field by a change of the quadric, along the horizontal tangent at a heading, over the horizontal field:
 * the heading error. h is the field; w, b the ellipsoid; q the changed quadric. */
static int turned(const jaxcal_real q[MONOMIALS], const jaxcal_real u[3], jaxcal_real cosine, jaxcal_real sine, jaxcal_real *turn) {
  jaxcal_real w[3][3], b[3], x[2];
  if (!ellipsoid(q, w, b)) return 0;
  for (int i = 0; i < 2; ++i) x[i] = w[i][0] * (u[0] - b[0]) + w[i][1] * (u[1] - b[1]) + w[i][2] * (u[2] - b[2]);
  *turn = -sine * x[0] - cosine * x[1];
  return 1;
}

/* Heading error at level from the errors of the quadric, whose covariance is variance * psi^-1; psi is factored with q q' added. */
static jaxcal_real expected(const jaxcal_real psi[PACKED], const jaxcal_real q[MONOMIALS], jaxcal_real variance, jaxcal_real level) {
  static const int8_t COS[8] = {2, 1, 0, -1, -2, -1, 0, 1}; /* 1 stands for the root of a half, 2 for 1 */
  const jaxcal_real step = ROOT(ROOT(TINY)) / 4, steep = ROOT(1 - level * level);
  jaxcal_real w[3][3], b[3], c[3][3], total = 0;
  if (!ellipsoid(q, w, b)) return INFINITY;
  const jaxcal_real det = cofactors(w, c);
  if (!(det > 0)) return INFINITY;
  for (int k = 0; k < 8; ++k) {
    const jaxcal_real unit[3] = {0, R(0.70710678), 1}, x = COS[k] < 0 ? -unit[-COS[k]] : unit[COS[k]];
    const int turned_back = COS[(k + 6) % 8];
    const jaxcal_real y = turned_back < 0 ? -unit[-turned_back] : unit[turned_back];
    /* the reading u at this heading: w (u - b) = h */
    const jaxcal_real h[3] = {level * x, -level * y, steep};
    jaxcal_real u[3], slope[MONOMIALS], changed[MONOMIALS];
    for (int i = 0; i < 3; ++i) {
      u[i] = b[i];
      for (int j = 0; j < 3; ++j) u[i] += c[j][i] / det * h[j];
    }
    for (int j = 0; j < MONOMIALS; ++j) {
      jaxcal_real up, down;
      memcpy(changed, q, sizeof changed);
      changed[j] = q[j] + step;
      if (!turned(changed, u, x, y, &up)) return INFINITY;
      changed[j] = q[j] - step;
      if (!turned(changed, u, x, y, &down)) return INFINITY;
      slope[j] = (up - down) / (2 * step * level);
    }
    forward(psi, slope, MONOMIALS);
    for (int j = 0; j < MONOMIALS; ++j) total += slope[j] * slope[j];
  }
  return ROOT(variance * total / 8);
}

/* Newton's method; the frame keeps the value near 1. */
static jaxcal_real cube_root(jaxcal_real value) {
  jaxcal_real x = 1;
  for (int round = 0; round < 2 * ROUNDS; ++round) x = (2 * x + value / (x * x)) / 3;
  return x;
}

/* The fit of a quadric: matrix, bias, noise, error and verdict. s2 is the variance of the noise in the frame, q has length one. */
static int finish(jaxcal_mag *mag, jaxcal_real psi[PACKED], const jaxcal_real q[MONOMIALS], jaxcal_real s2) {
  const jaxcal_real limit = R(0.017453293), n = mag->sum[0];
  jaxcal_real w[3][3], b[3], c[3][3];
  mag->solved = 0;
  mag->verdict = JAXCAL_REFUSED;
  mag->heading_error = INFINITY;
  if (!ellipsoid(q, w, b)) {
    mag->reasons |= JAXCAL_NO_ELLIPSOID;
    return mag->verdict;
  }
  products(mag, s2, TINY, PLAIN, psi);
  for (int i = 0; i < MONOMIALS; ++i)
    for (int j = 0; j <= i; ++j) psi[at(i, j)] += q[i] * q[j]; /* the length of q is free */
  const jaxcal_real radius = 1 / cube_root(cofactors(w, c));
  mag->field = radius * mag->scale;
  for (int i = 0; i < 3; ++i) {
    mag->bias[i] = mag->centre[i] + mag->scale * b[i];
    for (int j = 0; j < 3; ++j) mag->matrix[i][j] = w[i][j] * radius;
  }
  mag->noise = ROOT(s2) * mag->scale;
  /* the covariance of q is the mean square of the residuals over the degrees of freedom, times the inverse of the products */
  if (factor(psi, MONOMIALS)) mag->heading_error = expected(psi, q, SIZE(residual(mag, 0, q)) / (n - 9), mag->horizontal);
  if (!(2 * mag->heading_error <= limit)) mag->reasons |= JAXCAL_UNCERTAIN;
  if (!(s2 <= R(0.01) * radius * radius)) mag->reasons |= JAXCAL_NOISY;
  mag->verdict = !(mag->heading_error <= 5 * limit) ? JAXCAL_REFUSED : mag->reasons ? JAXCAL_WEAK : JAXCAL_GOOD;
  mag->solved = mag->verdict != JAXCAL_REFUSED;
  return mag->verdict;
}

static void normalise(jaxcal_real q[MONOMIALS]) {
  jaxcal_real size = 0;
  for (int i = 0; i < MONOMIALS; ++i) size += q[i] * q[i];
  for (int i = 0; i < MONOMIALS; ++i) q[i] /= size > 0 ? ROOT(size) : 1;
}

/* Whether the readings are too few, or near one plane (extent below 0.05 of their size), for any fit; their frame is made first. */
static int unusable(jaxcal_mag *mag) {
  jaxcal_real spread[6];
  mag->reasons = 0;
  if (mag->count >= LEAST) {
    recentre(mag);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j)
        spread[at(i, j)] = mag->sum[product(6 + i, 6 + j)] / mag->sum[0] - (i == j ? R(0.0025) : 0);
    if (factor(spread, 3)) return 0;
    mag->reasons = JAXCAL_NO_ELLIPSOID;
  } else {
    mag->reasons = JAXCAL_FEW;
  }
  mag->solved = 0;
  mag->verdict = JAXCAL_REFUSED;
  mag->heading_error = INFINITY;
  return 1;
}

/* Adjusted least squares: the smallest noise that makes the products singular, and the quadric of their null vector. */
int jaxcal_mag_solve(jaxcal_mag *mag) {
  jaxcal_real psi[PACKED], q[MONOMIALS], low = 0, high = R(TINY) / 64, ridge = 0;
  if (unusable(mag)) return mag->verdict;
  for (int round = 0; round < 2 * ROUNDS; ++round, high *= 4) { /* bracket the noise, then halve */
    products(mag, high, 0, PLAIN, psi);
    if (!factor(psi, MONOMIALS) || high > R(0.36)) break;
    low = high;
  }
  for (int round = 0; round < ROUNDS; ++round) {
    const jaxcal_real middle = (low + high) / 2;
    products(mag, middle, 0, PLAIN, psi);
    if (factor(psi, MONOMIALS))
      low = middle;
    else
      high = middle;
  }
  for (int round = 0; round < ROUNDS; ++round, ridge = 2 * ridge + R(TINY) / 64) { /* exact readings are singular without any noise */
    products(mag, low, ridge, PLAIN, psi);
    if (factor(psi, MONOMIALS)) break;
  }
  for (int i = 0; i < MONOMIALS; ++i) q[i] = 1;
  for (int round = 0; round < 8; ++round) { /* inverse iteration */
    forward(psi, q, MONOMIALS);
    backward(psi, q, MONOMIALS);
    normalise(q);
  }
  return finish(mag, psi, q, low);
}

/* Least squares under 4AC - B^2 = 1 (the magnetometer paper): S q = lambda C q for x^2, xy, y^2, the other seven eliminated. */
int jaxcal_mag_constrained(jaxcal_mag *mag) {
  static const uint8_t LAST[MONOMIALS] = {3, 4, 5, 6, 7, 8, 9, 0, 1, 2};
  jaxcal_real psi[PACKED], x[MONOMIALS], b[3][3] = {{0, 0, 2}, {0, -1, 0}, {2, 0, 0}}, v[3][3], ridge = 0;
  if (unusable(mag)) return mag->verdict;
  for (int round = 0; round < ROUNDS; ++round, ridge = 2 * ridge + R(TINY) / 64) {
    products(mag, 0, ridge, LAST, psi);
    if (factor(psi, MONOMIALS)) break;
  }
  /* S = L L' with the last three rows of the factor, so that L^-1 C L^-T is symmetric; its one positive eigenvalue is 1 / lambda */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) x[at(i, j)] = psi[at(7 + i, 7 + j)];
  for (int side = 0; side < 2; ++side) {
    for (int i = 0; i < 3; ++i) forward(x, b[i], 3); /* from one side; then from the other */
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) v[i][j] = b[j][i];
    memcpy(b, v, sizeof b);
  }
  eigen(b, v);
  int best = 0;
  for (int i = 1; i < 3; ++i)
    if (b[i][i] > b[best][best]) best = i;
  for (int i = 0; i < MONOMIALS; ++i) x[i] = i < 7 ? 0 : v[i - 7][best];
  backward(psi, x, MONOMIALS);
  for (int i = 0; i < MONOMIALS; ++i) psi[LAST[i]] = x[i]; /* which is free now */
  memcpy(x, psi, sizeof x);
  normalise(x);
  /* the noise: the mean square of the residuals over its slope in the variance */
  const jaxcal_real step = R(1) / 1024, square = residual(mag, 0, x);
  return finish(mag, psi, x, SIZE(square * step / (square - residual(mag, step, x))));
}

void jaxcal_faces_begin(jaxcal_faces *faces) {
  memset(faces, 0, sizeof *faces);
}

void jaxcal_faces_add(jaxcal_faces *faces, const jaxcal_real y[3]) {
  int axis = 0;
  if (!finite3(y)) return;
  for (int i = 1; i < 3; ++i)
    if (SIZE(y[i]) > SIZE(y[axis])) axis = i;
  const int face = 2 * axis + (y[axis] < 0);
  if (faces->count[face] == UINT16_MAX) return;
  ++faces->count[face];
  for (int i = 0; i < 3; ++i) faces->mean[face][i] += (y[i] - faces->mean[face][i]) / faces->count[face];
}

int jaxcal_faces_solve(const jaxcal_faces *faces, jaxcal_real gravity, jaxcal_real bias[3], jaxcal_real scale[3]) {
  for (int i = 0; i < 3; ++i) {
    const jaxcal_real up = faces->mean[2 * i][i], down = faces->mean[2 * i + 1][i];
    if (faces->count[2 * i] == 0 || faces->count[2 * i + 1] == 0) return 0;
    bias[i] = (up + down) / 2;
    scale[i] = (up - down) / (2 * gravity);
  }
  return 1;
}

void jaxcal_rest_begin(jaxcal_rest *rest, jaxcal_real limit, uint16_t length) {
  memset(rest, 0, sizeof *rest);
  rest->limit = limit;
  rest->length = length;
}

int jaxcal_rest_add(jaxcal_rest *rest, const jaxcal_real y[3]) {
  int still = 1;
  if (!finite3(y)) return 0;
  ++rest->count;
  for (int i = 0; i < 3; ++i) { /* mean and sum of squares in one pass (Welford 1962) */
    const jaxcal_real away = y[i] - rest->mean[i];
    rest->mean[i] += away / rest->count;
    rest->square[i] += away * (y[i] - rest->mean[i]);
  }
  if (rest->count < rest->length) return 0;
  for (int i = 0; i < 3; ++i) still = still && rest->square[i] <= rest->limit * rest->limit * rest->length;
  if (still && rest->windows < UINT16_MAX) ++rest->windows;
  for (int i = 0; i < 3; ++i) {
    if (still) rest->bias[i] += (rest->mean[i] - rest->bias[i]) / rest->windows;
    rest->mean[i] = rest->square[i] = 0;
  }
  rest->count = 0;
  return still;
}
