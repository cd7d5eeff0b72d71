/* The core as a shared library: what drives it hands over the time, the readings and the frames. */
#ifndef DPR_HOST_H
#define DPR_HOST_H

#include "../../device.h"

#define DPR_HOST_FRAMES 2048u /* that wait to be taken; a reading makes at most ten */

/* What the firmware did to latch and timer; whoever plays the hardware acts on it after every call. */
typedef struct {
    uint32_t release_tick;
    uint16_t rate_hz;
    uint8_t pose;
    bool hold, release, start_ticks;
} dpr_actions_t;

typedef struct {
    dpr_device_t device;
    dpr_identity_t identity;
    dpr_actions_t actions;
    uint32_t millis, tick;
    uint16_t fraction;
    uint8_t fault;
    uint8_t major_shift; /* what it claims, less what it was built from */
    uint32_t schema_shift;
    const dpr_reading_t *readings;
    size_t waiting;
    size_t count;
    dpr_frame_t frames[DPR_HOST_FRAMES];
} dpr_host_t;

size_t dpr_host_size(void);
size_t dpr_host_decoder_size(void);

/* `host` is dpr_host_size() bytes of the caller's. */
void dpr_host_start(dpr_host_t *host, const dpr_identity_t *identity);

/* From now on it is to the link what a firmware built from that dpr.dbc is; for tests of the other end. */
void dpr_host_claim(dpr_host_t *host, uint8_t major, uint32_t schema_hash);

void dpr_host_receive(
    dpr_host_t *host, const dpr_frame_t *frame, uint32_t millis, uint32_t tick, uint16_t fraction);

/* At most DPR_HOST_FRAMES / 16 readings. */
void dpr_host_poll(dpr_host_t *host, uint32_t millis, const dpr_reading_t *readings, size_t count);

/* The fault that the hardware has from now on; 0 none. */
void dpr_host_set_fault(dpr_host_t *host, uint8_t fault);

void dpr_host_note_dropped(dpr_host_t *host, uint16_t samples);

/* Moves the waiting frames, DPR_HOST_FRAMES at most, to `frames`; returns how many. */
size_t dpr_host_take(dpr_host_t *host, dpr_frame_t *frames);

/* The actions since the last call. */
dpr_actions_t dpr_host_actions(dpr_host_t *host);

uint8_t dpr_host_state(const dpr_host_t *host);
bool dpr_host_latched(const dpr_host_t *host);
uint32_t dpr_host_next_tick(const dpr_host_t *host);

/* Decodes a chunk of a byte stream; `frames` has room for one in every five bytes. Returns how many there were. */
size_t dpr_host_decode(dpr_decoder_t *decoder, const uint8_t *data, size_t length, dpr_frame_t *frames);

/* Packets refused so far, by cause. */
void dpr_host_errors(const dpr_decoder_t *decoder, uint32_t *crc, uint32_t *framing);

#endif
