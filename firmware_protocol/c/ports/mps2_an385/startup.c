/* Start-up code: vectors, initialised data, zeroed data, main(). */
#include <stdint.h>

#include "board.h"

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;

int main(void);
void reset(void);
static void halt(void);

typedef void (*vector_t)(void);

/* The first sixteen vectors belong to the core; the following ones to the board, by number. */
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    vector_t core[15];
    vector_t board[IRQ_TIMER0 + 1];
} VECTORS = {
    &stack_top,
    {[0] = reset, [1] = halt, [2] = halt, [3] = halt, [4] = halt, [5] = halt, [14] = on_millisecond},
    {[IRQ_UART0_RX] = on_link_byte, [IRQ_UART1_RX] = on_bench_byte, [IRQ_TIMER0] = on_tick},
};

void reset(void)
{
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    main();
    halt();
}

static void halt(void)
{
    for (;;) {
    }
}
