/* The example on a Cortex-M7 of MPS2 with AN500: weights in flash at 1 MiB, a UART, and no library. */
#include "platform.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART 0x40004000u

extern uint32_t stack_start[], data_start[], data_end[], data_load[], bss_start[], bss_end[];

void put_character(char character) {
    while (REGISTER(UART + 4) & 1) {}
    REGISTER(UART) = (uint8_t)character;
}

/* Ends the simulation by semihosting: SYS_EXIT_EXTENDED. */
static void leave(int status) {
    volatile uint32_t arguments[2] = { 0x20026, (uint32_t)status };
    register uint32_t operation __asm__("r0") = 0x20;
    register volatile uint32_t *parameters __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : : "r"(operation), "r"(parameters) : "memory");
}

void reset(void) {
    REGISTER(0xe000ed88) |= 0xf << 20; /* switches the floating-point unit on */
    __asm__ volatile("dsb; isb");
    for (uint32_t *to = data_start, *from = data_load; to < data_end;) *to++ = *from++;
    for (uint32_t *to = bss_start; to < bss_end;) *to++ = 0;
    REGISTER(UART + 0x10) = 16;
    REGISTER(UART + 8) = 1;
    const uint8_t *weights = (const uint8_t *)0x00100000;
    uint32_t length = *(const uint32_t *)(weights + 8); /* the file says its own */
    leave(register_clouds(weights, length));
    for (;;) {}
}

static void fault(void) {
    leave(3);
    for (;;) {}
}

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    stack_start, (void *)reset, (void *)fault, (void *)fault,
    (void *)fault, (void *)fault, (void *)fault,
};
