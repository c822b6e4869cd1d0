/* Collect readings of a magnetometer, an accelerometer and a gyroscope, and calibrate them where they are read.
 *
 * C99, no heap, no recursion, every loop is bounded. One source file of the program has #define JAXCAL_IMPLEMENTATION before it
 * includes this header; -DJAXCAL_DOUBLE makes all numbers double. Compile without -ffast-math, which undoes the compensation of
 * the sums (Kahan). A magnetometer takes 432 bytes, and jaxcal_mag_solve 1.1 kB of stack.
 *
 *   jaxcal_mag mag;
 *   jaxcal_mag_begin(&mag);
 *   while (jaxcal_mag_solve(&mag) != JAXCAL_GOOD)       // turn the device in all directions meanwhile
 *     for (int i = 0; i < 50; ++i)
 *       if (read_magnetometer(m)) jaxcal_mag_add(&mag, m);
 *   jaxcal_mag_correct(&mag, m, corrected);
 */
#include <stdint.h>

#ifdef JAXCAL_DOUBLE
typedef double jaxcal_real;
#else
typedef float jaxcal_real;
#endif

enum { JAXCAL_MOMENTS = 35, JAXCAL_BINS = 24 };

/* Verdict, the worst reason decides. */
enum { JAXCAL_GOOD = 0, JAXCAL_WEAK = 1, JAXCAL_REFUSED = 2 };

/* Reasons, as bits. */
enum {
  JAXCAL_FEW = 1,           /* fewer readings than JAXCAL_LEAST */
  JAXCAL_NO_ELLIPSOID = 2,  /* the readings lie on no ellipsoid: near one plane, or disturbed */
  JAXCAL_UNCERTAIN = 4,     /* the heading may be wrong by more than the limit: turn into further directions */
  JAXCAL_NOISY = 8          /* the noise is large, or the field changed meanwhile */
};

typedef struct {
  jaxcal_real sum[JAXCAL_MOMENTS];   /* moments of u = (m - centre) / scale: sum of x^a y^b z^c, a + b + c <= 4 */
  jaxcal_real lost[JAXCAL_MOMENTS];  /* what rounding took from each sum */
  jaxcal_real centre[3], scale;      /* frame of u */
  jaxcal_real last[3];               /* last reading, to see one that is held */
  uint16_t bin[JAXCAL_BINS];         /* admitted readings by direction */
  uint16_t count, held, outliers;    /* readings admitted, repeated, and left out as far from the running fit */
  /* the fit: corrected = matrix (m - bias), of the size that the readings have; solved is 0 before there is one */
  jaxcal_real matrix[3][3], bias[3], field;
  jaxcal_real noise;                 /* standard deviation of one axis, in the unit of the readings */
  jaxcal_real heading_error;         /* to expect at level, root mean square over all headings, in rad */
  jaxcal_real horizontal;            /* horizontal share of the field, for heading_error: 0.54 (a dip of 57 degrees) unless set */
  uint8_t solved, verdict, reasons;
} jaxcal_mag;

void jaxcal_mag_begin(jaxcal_mag *mag);
int jaxcal_mag_add(jaxcal_mag *mag, const jaxcal_real m[3]);  /* 1 if the reading was admitted */
int jaxcal_mag_solve(jaxcal_mag *mag);                        /* the verdict */
int jaxcal_mag_constrained(jaxcal_mag *mag);                  /* the same with the constraint 4AC - B^2 = 1 */
void jaxcal_mag_correct(const jaxcal_mag *mag, const jaxcal_real m[3], jaxcal_real x[3]);

/* Six faces of an accelerometer: hold each axis up and down. The reading of a level error of e is wrong by e^2 / 2 only. */
typedef struct {
  jaxcal_real mean[6][3];  /* mean of each face: +x, -x, +y, -y, +z, -z up */
  uint16_t count[6];
} jaxcal_faces;

void jaxcal_faces_begin(jaxcal_faces *faces);
void jaxcal_faces_add(jaxcal_faces *faces, const jaxcal_real y[3]);  /* readings at rest */
/* true = (reading - bias) / scale; 1 if all six faces are there */
int jaxcal_faces_solve(const jaxcal_faces *faces, jaxcal_real gravity, jaxcal_real bias[3], jaxcal_real scale[3]);

/* Bias of a gyroscope at rest: the mean of windows whose scatter is at most `limit` (one axis, same unit as the readings). */
typedef struct {
  jaxcal_real bias[3], mean[3], square[3], limit;
  uint16_t length, count, windows;
} jaxcal_rest;

void jaxcal_rest_begin(jaxcal_rest *rest, jaxcal_real limit, uint16_t length);
int jaxcal_rest_add(jaxcal_rest *rest, const jaxcal_real y[3]);  /* 1 if a window was still and the bias is new */
