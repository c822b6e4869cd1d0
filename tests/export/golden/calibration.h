/* Sensor calibration written by jaxcal. SI units, sensor frame.
 * accel: x = matrix * (y - bias)                     m/s^2
 * gyro:  x = matrix * (y - bias - g_sensitivity * a) rad/s, a = corrected accel
 * mag:   x = matrix * (y - bias)                     tesla
 * bias is at JAXCAL_TEMPERATURE_REFERENCE_C; add coeff[0]*d + coeff[1]*d^2 + coeff[2]*d^3,
 * d = temperature - reference, temperature clipped to the valid range.
 */
#ifndef JAXCAL_CALIBRATION_H
#define JAXCAL_CALIBRATION_H

#define JAXCAL_TEMPERATURE_REFERENCE_C 35.0f
#define JAXCAL_TEMPERATURE_MIN_C 10.0f
#define JAXCAL_TEMPERATURE_MAX_C 60.0f

static const float JAXCAL_ACCEL_MATRIX[3][3] = {{1.002f, -0.000998f, 0.00201f}, {0.0f, 0.998f, -0.0015075f}, {0.0f, 0.0f, 1.005f}};
static const float JAXCAL_ACCEL_BIAS[3] = {0.12f, -0.08f, 0.25f};
static const float JAXCAL_ACCEL_BIAS_TEMPERATURE[3][3] = {{0.0012f, -2.0e-05f, 1.0e-07f}, {-0.0008f, 1.0e-05f, 0.0f}, {0.0025f, 3.0e-05f, -2.0e-07f}}; /* [axis][power-1] */
static const float JAXCAL_GYRO_MATRIX[3][3] = {{1.01f, 0.001188f, -0.0008f}, {-0.000505f, 0.99f, 0.0016f}, {0.000909f, -0.001089f, 1.0f}};
static const float JAXCAL_GYRO_BIAS[3] = {0.01f, -0.02f, 0.005f};
static const float JAXCAL_GYRO_BIAS_TEMPERATURE[3][3] = {{2.0e-05f, 0.0f, 0.0f}, {-1.5e-05f, 1.0e-07f, 0.0f}, {5.0e-06f, -2.0e-07f, 1.0e-09f}}; /* [axis][power-1] */
static const float JAXCAL_GYRO_G_SENSITIVITY[3][3] = {{0.0001f, 0.0f, 0.0f}, {0.0f, -5.0e-05f, 0.0f}, {0.0f, 0.0f, 2.0e-05f}};
static const float JAXCAL_MAG_MATRIX[3][3] = {{1.05f, 0.02f, -0.01f}, {0.02f, 0.97f, 0.03f}, {-0.01f, 0.03f, 1.0f}};
static const float JAXCAL_MAG_BIAS[3] = {1.25e-05f, -7.25e-06f, 3.0e-05f};

static inline void jaxcal_apply(const float m[3][3], const float b[3], const float y[3], float x[3]) {
  for (int i = 0; i < 3; ++i)
    x[i] = m[i][0] * (y[0] - b[0]) + m[i][1] * (y[1] - b[1]) + m[i][2] * (y[2] - b[2]);
}

/* degC above the reference, within the range; 0 where the temperature is not known (NAN) */
static inline float jaxcal_above(float temperature, float reference, float low, float high) {
  const float inside = temperature < low ? low : temperature > high ? high : temperature;
  return inside == inside ? inside - reference : 0;
}

/* c[0] d + c[1] d^2 + ... + c[n - 1] d^n (Horner) */
static inline float jaxcal_powers(const float c[], int n, float d) {
  float sum = 0;
  for (int k = n - 1; k >= 0; --k) sum = (sum + c[k]) * d;
  return sum;
}

/* accel: bias at a temperature in degC (NAN if it is not known), days after the calibration; and y without its errors */
static inline void jaxcal_bias_accel(float temperature, float days, float b[3]) {
  const float d = jaxcal_above(temperature, JAXCAL_TEMPERATURE_REFERENCE_C, JAXCAL_TEMPERATURE_MIN_C, JAXCAL_TEMPERATURE_MAX_C);
  (void)days;
  for (int i = 0; i < 3; ++i) b[i] = JAXCAL_ACCEL_BIAS[i] + jaxcal_powers(JAXCAL_ACCEL_BIAS_TEMPERATURE[i], 3, d);
}

static inline void jaxcal_correct_accel(const float y[3], float temperature, float days, float x[3]) {
  float b[3];
  jaxcal_bias_accel(temperature, days, b);
  jaxcal_apply(JAXCAL_ACCEL_MATRIX, b, y, x);
}

/* gyro: bias at a temperature in degC (NAN if it is not known), days after the calibration; and y without its errors */
static inline void jaxcal_bias_gyro(float temperature, float days, float b[3]) {
  const float d = jaxcal_above(temperature, JAXCAL_TEMPERATURE_REFERENCE_C, JAXCAL_TEMPERATURE_MIN_C, JAXCAL_TEMPERATURE_MAX_C);
  (void)days;
  for (int i = 0; i < 3; ++i) b[i] = JAXCAL_GYRO_BIAS[i] + jaxcal_powers(JAXCAL_GYRO_BIAS_TEMPERATURE[i], 3, d);
}

static inline void jaxcal_correct_gyro(const float y[3], const float a[3], float temperature, float days, float x[3]) {
  float b[3];
  jaxcal_bias_gyro(temperature, days, b);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) b[i] += JAXCAL_GYRO_G_SENSITIVITY[i][k] * a[k];
  jaxcal_apply(JAXCAL_GYRO_MATRIX, b, y, x);
}

/* mag: bias at a temperature in degC (NAN if it is not known), days after the calibration; and y without its errors */
static inline void jaxcal_bias_mag(float temperature, float days, float b[3]) {
  (void)temperature;
  (void)days;
  for (int i = 0; i < 3; ++i) b[i] = JAXCAL_MAG_BIAS[i];
}

static inline void jaxcal_correct_mag(const float y[3], float temperature, float days, float x[3]) {
  float b[3];
  jaxcal_bias_mag(temperature, days, b);
  jaxcal_apply(JAXCAL_MAG_MATRIX, b, y, x);
}

#endif
