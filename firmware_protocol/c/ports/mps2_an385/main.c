/* Port to Arm's MPS2 board: hal.h with a timer that captures the counters, a millisecond clock and a UART.
 *
 * Each ring buffer has one writer and one reader: an interrupt and the main loop. Data that both change are changed
 * with interrupts disabled.
 */
#include <string.h>

#include "../../device.h"
#include "board.h"
#include "rods.h"

/* Powers of two, so that the indices may wrap. */
#define RECEIVED 256u /* bytes */
#define READINGS 64u
#define TO_SEND 4096u /* bytes: 290 ms of samples at 1 kHz */

static const dpr_identity_t IDENTITY = {
    .uid = 0x00A385000000DEADu,
    .counts_per_rev = {COUNTS_PER_REV, COUNTS_PER_REV, COUNTS_PER_REV},
    .rate_max_hz = 4000,
    .rate_default_hz = 1000,
    .firmware = {1, 0, 0},
    .node = 1,
};

static volatile uint32_t millis;
static volatile uint8_t bench_fault;

static volatile uint8_t received[RECEIVED];
static volatile uint32_t received_in, received_out;

static rods_t rods;
static float period;
static volatile dpr_reading_t readings[READINGS];
static volatile uint32_t readings_in, readings_out;
static volatile uint32_t next_tick;

static uint8_t to_send[TO_SEND];
static uint32_t send_in, send_out;

void on_millisecond(void)
{
    millis++;
}

void on_link_byte(void)
{
    UART0->interrupt = UART_RX_INTERRUPT;
    uint8_t byte = (uint8_t)UART0->data;
    if (received_in - received_out < RECEIVED) {
        received[received_in % RECEIVED] = byte;
        received_in++;
    }
}

/* `r` resets the board. A digit is echoed and sets the fault of the hardware. */
void on_bench_byte(void)
{
    UART1->interrupt = UART_RX_INTERRUPT;
    uint8_t byte = (uint8_t)UART1->data;
    if (byte == 'r') {
        RESET_CONTROL = RESET_REQUEST;
    } else if (byte >= '0' && byte <= '9') {
        bench_fault = (uint8_t)(byte - '0');
        UART1->data = byte;
    }
}

/* On a board with encoders, the timer captures their counters in hardware, and this function reads the registers. */
void on_tick(void)
{
    TIMER0->interrupt = TIMER_INTERRUPT;
    if (readings_in - readings_out < READINGS) {
        dpr_reading_t reading = {.tick = next_tick};
        rods_read(&rods, reading.counts);
        readings[readings_in % READINGS] = reading;
        readings_in++;
    }
    next_tick++;
    rods_step(&rods, period);
}

uint32_t hal_millis(void *port)
{
    (void)port;
    return millis;
}

void hal_hold(void *port, uint8_t pose)
{
    (void)port;
    MASK_INTERRUPTS();
    rods_place(&rods, pose);
    UNMASK_INTERRUPTS();
}

/* The next tick is read before the rods move: it is the last one at rest and the first one of the swing. */
uint32_t hal_release(void *port)
{
    (void)port;
    MASK_INTERRUPTS();
    uint32_t tick = next_tick;
    rods_let_go(&rods);
    UNMASK_INTERRUPTS();
    return tick;
}

void hal_start_ticks(void *port, uint16_t rate_hz)
{
    (void)port;
    MASK_INTERRUPTS();
    TIMER0->control = 0;
    TIMER0->interrupt = TIMER_INTERRUPT;
    NVIC_CLEAR_PENDING = 1u << IRQ_TIMER0;
    readings_out = readings_in;
    next_tick = 0;
    period = 1.0f / (float)rate_hz;
    TIMER0->reload = CLOCK_HZ / rate_hz - 1u;
    TIMER0->value = TIMER0->reload;
    TIMER0->control = TIMER_ENABLE | TIMER_INTERRUPT_ENABLE;
    UNMASK_INTERRUPTS();
}

bool hal_next_reading(void *port, dpr_reading_t *reading)
{
    (void)port;
    if (readings_out == readings_in) {
        return false;
    }
    *reading = readings[readings_out % READINGS];
    readings_out++;
    return true;
}

/* Tick 0 occurs one period after the start, so the time at the start is -1 tick. */
void hal_time(void *port, uint32_t *tick, uint16_t *fraction)
{
    (void)port;
    uint32_t passed, before;
    do {
        before = next_tick;
        passed = TIMER0->reload - TIMER0->value;
    } while (before != next_tick);
    *tick = before == 0 ? 0 : before - 1u;
    *fraction = before == 0 ? 0 : (uint16_t)(((uint64_t)passed << 16) / (TIMER0->reload + 1u));
}

bool hal_send(void *port, const dpr_frame_t *frame)
{
    (void)port;
    uint8_t line[DPR_MAX_ENCODED];
    uint32_t length = (uint32_t)dpr_frame_encode(frame, line);
    if (TO_SEND - (send_in - send_out) < length) {
        return false;
    }
    for (uint32_t i = 0; i < length; i++) {
        to_send[send_in++ % TO_SEND] = line[i];
    }
    return true;
}

uint8_t hal_fault(void *port)
{
    (void)port;
    return bench_fault;
}

static void start_board(void)
{
    UART0->divider = UART_FASTEST;
    UART0->control = UART_TX_ENABLE | UART_RX_ENABLE | UART_RX_INTERRUPT_ENABLE;
    UART1->divider = UART_FASTEST;
    UART1->control = UART_TX_ENABLE | UART_RX_ENABLE | UART_RX_INTERRUPT_ENABLE;
    SYSTICK->reload = CLOCK_HZ / 1000u - 1u;
    SYSTICK->value = 0;
    SYSTICK->control = SYSTICK_ENABLE_WITH_INTERRUPT;
    NVIC_ENABLE = 1u << IRQ_UART0_RX | 1u << IRQ_UART1_RX | 1u << IRQ_TIMER0;
    rods_place(&rods, 0);
    rods_let_go(&rods);
}

static void print_on_bench(const char *text)
{
    for (; *text != '\0'; text++) {
        while (UART1->state & UART_TX_FULL) {
        }
        UART1->data = (uint8_t)*text;
    }
}

static void receive(dpr_device_t *device, dpr_decoder_t *decoder)
{
    dpr_frame_t frame;
    while (received_out != received_in) {
        uint8_t byte = received[received_out % RECEIVED];
        received_out++;
        if (dpr_decoder_push(decoder, byte, &frame)) {
            dpr_device_receive(device, &frame);
        }
    }
}

static void transmit(void)
{
    while (send_out != send_in && !(UART0->state & UART_TX_FULL)) {
        UART0->data = to_send[send_out++ % TO_SEND];
    }
}

int main(void)
{
    static dpr_device_t device;
    static dpr_decoder_t decoder;
    start_board();
    dpr_device_start(&device, &IDENTITY, NULL);
    print_on_bench("started\n");
    for (;;) {
        receive(&device, &decoder);
        dpr_device_poll(&device);
        transmit();
        __asm__ volatile("wfi"); /* wait for the next byte, tick or millisecond */
    }
}
