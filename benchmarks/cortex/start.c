/* Start of a program in an emulated board: the vector table, the floating-point unit, and output by semihosting. */
#include <stdint.h>

int main(void);
void initialise_monitor_handles(void);

static void reset(void) {
  *(volatile uint32_t *)0xE000ED88 |= 0xFU << 20;
  initialise_monitor_handles();
  main();
  for (;;) {
  }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {(void (*)(void))0x20010000, reset};
