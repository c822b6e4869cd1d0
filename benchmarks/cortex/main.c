/* Instructions of a correction of three sensors, and with the stack of one reading and of one solution. The board's clock has a tick of 40 ns, and an instruction takes 32 ns
 * (qemu-system-arm -icount shift=5), so that a tick is 1.25 instructions. */
#include "sensors.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define CONTROL (*(volatile uint32_t *)0xE000E010)
#define RELOAD (*(volatile uint32_t *)0xE000E014)
#define VALUE (*(volatile uint32_t *)0xE000E018)
#define PAINT 0xA5A5A5A5U

void correct(const float y[9], float temperature, float days, float x[9]);

static jaxcal_mag mag;
static volatile uint32_t *low;
static uint32_t state = 7;

static float uniform(void) {
  state = state * 1664525U + 1013904223U;
  return (float)(state >> 8) / 16777216.0f;
}

static float normal(void) {
  float sum = -6;
  for (int i = 0; i < 12; ++i) sum += uniform();
  return sum;
}

/* Fill the free stack, and afterwards see how much of it was used. */
static uint32_t stack(int fill) {
  volatile uint32_t here = 0;
  if (fill) {
    low = (volatile uint32_t *)((uintptr_t)&here - 6000);
    for (volatile uint32_t *p = low; p < &here - 64; ++p) *p = PAINT;
    return here;
  }
  while (*low == PAINT) ++low;
  return (uint32_t)((uintptr_t)&here - (uintptr_t)low);
}

static void timed(const char *name, int (*solve)(jaxcal_mag *)) {
  stack(1);
  VALUE = 0; /* which also clears the flag that the clock has gone round */
  const uint32_t begin = VALUE;
  const int verdict = solve(&mag);
  const uint32_t ticks = ((begin - VALUE) & 0xFFFFFF) + (CONTROL >> 16 & 1) * 0x1000000;
  printf("\"%s\": {\"instructions\": %lu, \"stack\": %lu, \"verdict\": %d}, ", name, (unsigned long)(ticks * 5 / 4),
         (unsigned long)stack(0), verdict);
}

int main(void) {
  uint32_t total = 0, most = 0;
  RELOAD = 0xFFFFFF;
  VALUE = 0;
  CONTROL = 5;
  jaxcal_mag_begin(&mag);
  for (int i = 0; i < 500; ++i) {
    const float z = 2 * uniform() - 1, t = 6.2831853f * uniform(), r = sqrtf(1 - z * z), x = r * cosf(t), y = r * sinf(t);
    const float m[3] = {47 * (1.1f * x + 0.1f * z) + 20 + 0.2f * normal(), 45 * y - 10 + 0.2f * normal(),
                        47 * (z + 0.1f * x) + 5 + 0.2f * normal()};
    const uint32_t begin = VALUE;
    jaxcal_mag_add(&mag, m);
    const uint32_t ticks = (begin - VALUE) & 0xFFFFFF;
    total += ticks;
    if (ticks > most) most = ticks;
  }
  const float y[9] = {1, 2, 9, 0.1f, 0.2f, 0.3f, 2e-5f, 1e-5f, 4e-5f};
  float corrected[9];
  const uint32_t begin = VALUE;
  correct(y, 40, 10, corrected);
  const uint32_t ticks = (begin - VALUE) & 0xFFFFFF;
  printf("{\"corrected\": %lu, \"mean\": %lu, \"most\": %lu, ", (unsigned long)(ticks * 5 / 4), (unsigned long)(total / 500 * 5 / 4),
         (unsigned long)(most * 5 / 4));
  timed("constrained", jaxcal_mag_constrained);
  timed("solve", jaxcal_mag_solve);
  printf("\"memory\": %u, \"bias\": [%d, %d, %d]}\n", (unsigned)sizeof mag, (int)(1000 * mag.bias[0]), (int)(1000 * mag.bias[1]),
         (int)(1000 * mag.bias[2]));
  exit(0);
}
