/* Port to boards with the Arduino core: three incremental encoders on pin interrupts, a latch on a pin, Serial.
 *
 * Copy the folder firmware_protocol/c, without its folder ports, to src/dpr next to this file. Then change pins, counts
 * per turn and UID. Readings are taken in loop(), which suffices for slow rods and coarse encoders. If your chip
 * has quadrature counters and a timer that captures them, read these in read_counts(), and sample in its interrupt.
 */
#include <Arduino.h>

#include "src/dpr/device.h"

static const uint8_t PIN_A[DPR_JOINTS] = {2, 4, 6}; /* pins with interrupts, like those of PIN_B */
static const uint8_t PIN_B[DPR_JOINTS] = {3, 5, 7};
static const uint8_t PIN_LATCH = 8; /* high: held */
static const uint32_t BAUD = 921600;

static const dpr_identity_t IDENTITY = {
    0x00A4D00000000001u,   /* UID, unique for each board */
    {16384, 16384, 16384}, /* counts per turn, after quadrature */
    1000,                  /* maximum rate */
    1000,                  /* rate of the tick while not streaming */
    {1, 0, 0},             /* version of this firmware */
    1,                     /* node */
    false,                 /* real time */
    {false, false}, 0,     /* no joint drives */
    {false, false}, 0, 0,  /* no drive of the arm */
};

static dpr_device_t device;
static dpr_decoder_t decoder;

/* --- encoders: counts are never reset --- */

static volatile int32_t counts[DPR_JOINTS];
static volatile uint8_t phases[DPR_JOINTS];

static uint8_t phase(uint8_t joint)
{
    return (uint8_t)(digitalRead(PIN_A[joint]) << 1 | digitalRead(PIN_B[joint]));
}

static void turned(uint8_t joint)
{
    /* Index: previous and present phase. If both lines changed at once, the direction is unknown. */
    static const int8_t STEPS[16] = {0, -1, 1, 0, 1, 0, 0, -1, -1, 0, 0, 1, 0, 1, -1, 0};
    uint8_t now = phase(joint);
    counts[joint] += STEPS[phases[joint] << 2 | now];
    phases[joint] = now;
}

static void turned0(void) { turned(0); }
static void turned1(void) { turned(1); }
static void turned2(void) { turned(2); }

static void read_counts(int32_t *read)
{
    noInterrupts(); /* all three counts at one instant */
    for (uint8_t joint = 0; joint < DPR_JOINTS; joint++) {
        read[joint] = counts[joint];
    }
    interrupts();
}

/* --- readings: one at every tick; if loop() is late, a missed tick leaves a gap --- */

static const uint8_t WAITING = 32;
static dpr_reading_t readings[WAITING];
static uint8_t first, waiting;
static uint32_t next_tick, start_us;
static uint16_t rate_hz = 1000;

static uint32_t due_us(uint32_t tick)
{
    return start_us + (uint32_t)((uint64_t)tick * 1000000u / rate_hz);
}

static void sample(void)
{
    while ((int32_t)(micros() - due_us(next_tick + 1)) >= 0) {
        next_tick++; /* missed */
    }
    if ((int32_t)(micros() - due_us(next_tick)) < 0) {
        return;
    }
    if (waiting < WAITING) {
        dpr_reading_t *reading = &readings[(first + waiting) % WAITING];
        reading->tick = next_tick;
        read_counts(reading->counts);
        waiting++;
    }
    next_tick++;
}

/* --- transmit buffer: the answer to HELLO has 120 bytes, but many boards have a buffer of 64 bytes --- */

static uint8_t outgoing[1024];
static uint16_t oldest, unsent;

/* --- functions of hal.h --- */

uint32_t hal_millis(void *)
{
    return millis();
}

void hal_hold(void *, uint8_t)
{
    digitalWrite(PIN_LATCH, HIGH);
}

uint32_t hal_release(void *)
{
    digitalWrite(PIN_LATCH, LOW);
    return next_tick;
}

void hal_start_ticks(void *, uint16_t rate)
{
    rate_hz = rate;
    next_tick = 0;
    waiting = 0;
    start_us = micros();
}

bool hal_next_reading(void *, dpr_reading_t *reading)
{
    if (waiting == 0) {
        return false;
    }
    *reading = readings[first];
    first = (uint8_t)((first + 1) % WAITING);
    waiting--;
    return true;
}

void hal_time(void *, uint32_t *tick, uint16_t *fraction)
{
    uint32_t passed = next_tick == 0 ? 0 : next_tick - 1;
    uint32_t since_us = micros() - due_us(passed);
    uint64_t part = (uint64_t)since_us * rate_hz * 65536u / 1000000u;
    *tick = passed;
    *fraction = (uint16_t)(part > 65535u ? 65535u : part);
}

bool hal_send(void *, const dpr_frame_t *frame)
{
    uint8_t line[DPR_MAX_ENCODED];
    size_t length = dpr_frame_encode(frame, line);
    if (sizeof outgoing - unsent < length) {
        return false;
    }
    for (size_t i = 0; i < length; i++) {
        outgoing[(oldest + unsent++) % sizeof outgoing] = line[i];
    }
    return true;
}

static void transmit(void)
{
    size_t contiguous = sizeof outgoing - oldest < unsent ? sizeof outgoing - oldest : unsent;
    int room = Serial.availableForWrite();
    size_t count = room > 0 && (size_t)room < contiguous ? (size_t)room : room > 0 ? contiguous : 0;
    if (count > 0) {
        Serial.write(&outgoing[oldest], count);
        oldest = (uint16_t)((oldest + count) % sizeof outgoing);
        unsent = (uint16_t)(unsent - count);
    }
}

uint8_t hal_fault(void *)
{
    return 0; /* return the number in dpr.dbc of a fault, for example of an encoder or of the latch's switch */
}

void setup()
{
    pinMode(PIN_LATCH, OUTPUT);
    static void (*const CHANGED[DPR_JOINTS])(void) = {turned0, turned1, turned2};
    for (uint8_t joint = 0; joint < DPR_JOINTS; joint++) {
        pinMode(PIN_A[joint], INPUT_PULLUP);
        pinMode(PIN_B[joint], INPUT_PULLUP);
        phases[joint] = phase(joint);
        attachInterrupt(digitalPinToInterrupt(PIN_A[joint]), CHANGED[joint], CHANGE);
        attachInterrupt(digitalPinToInterrupt(PIN_B[joint]), CHANGED[joint], CHANGE);
    }
    Serial.begin(BAUD);
    dpr_device_start(&device, &IDENTITY, nullptr);
}

void loop()
{
    dpr_frame_t frame;
    while (Serial.available() > 0) {
        if (dpr_decoder_push(&decoder, (uint8_t)Serial.read(), &frame)) {
            dpr_device_receive(&device, &frame);
        }
    }
    sample();
    dpr_device_poll(&device);
    transmit();
}
