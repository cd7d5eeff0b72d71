/* Registers of the MPS2 board that this port uses.
 *
 * Source: Arm Cortex-M System Design Kit (DDI 0479), APB timer and APB UART; Application Note AN385.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#define CLOCK_HZ 25000000u

#define IRQ_UART0_RX 0
#define IRQ_UART1_RX 2
#define IRQ_TIMER0 8

typedef struct {
    volatile uint32_t data, state, control, interrupt, divider;
} uart_t;

typedef struct {
    volatile uint32_t control, value, reload, interrupt;
} board_timer_t;

typedef struct {
    volatile uint32_t control, reload, value;
} systick_t;

#define TIMER0 ((board_timer_t *)0x40000000u)
#define UART0 ((uart_t *)0x40004000u) /* the link to the host */
#define UART1 ((uart_t *)0x40005000u) /* the bench: keys reset the board or set a fault; the board prints a line at every start */
#define SYSTICK ((systick_t *)0xE000E010u)
#define NVIC_ENABLE (*(volatile uint32_t *)0xE000E100u)
#define NVIC_CLEAR_PENDING (*(volatile uint32_t *)0xE000E280u)

#define RESET_CONTROL (*(volatile uint32_t *)0xE000ED0Cu)
#define RESET_REQUEST 0x05FA0004u

#define MASK_INTERRUPTS() __asm__ volatile("cpsid i" ::: "memory")
#define UNMASK_INTERRUPTS() __asm__ volatile("cpsie i" ::: "memory")

#define UART_TX_FULL 1u
#define UART_RX_FULL 2u
#define UART_TX_ENABLE 1u
#define UART_RX_ENABLE 2u
#define UART_RX_INTERRUPT_ENABLE 8u
#define UART_RX_INTERRUPT 2u
#define UART_FASTEST 16u /* smallest divider */

#define TIMER_ENABLE 1u
#define TIMER_INTERRUPT_ENABLE 8u
#define TIMER_INTERRUPT 1u

#define SYSTICK_ENABLE_WITH_INTERRUPT 7u

void on_millisecond(void);
void on_tick(void);
void on_link_byte(void);
void on_bench_byte(void);

#endif
