
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
