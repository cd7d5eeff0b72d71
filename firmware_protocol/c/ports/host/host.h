/* The core as a shared library. The calling program supplies time, readings and frames. */
#ifndef DPR_HOST_H
#define DPR_HOST_H

#include "../../device.h"

#define DPR_HOST_FRAMES 2048u /* waiting frames; a reading causes at most ten */

/* Actions of the firmware on latch and timer, which the program that simulates the hardware must carry out. */
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
    uint8_t major_shift; /* claimed version minus the version of its dpr.dbc */
    uint32_t schema_shift;
    const dpr_reading_t *readings;
    size_t waiting;
    size_t count;
    dpr_frame_t frames[DPR_HOST_FRAMES];
} dpr_host_t;

size_t dpr_host_size(void);
size_t dpr_host_decoder_size(void);

/* `host` is a buffer of the caller with dpr_host_size() bytes. */
void dpr_host_start(dpr_host_t *host, const dpr_identity_t *identity);

/* Behave on the link like a firmware with another version of dpr.dbc, to test the host. */
void dpr_host_claim(dpr_host_t *host, uint8_t major, uint32_t schema_hash);

void dpr_host_receive(
    dpr_host_t *host, const dpr_frame_t *frame, uint32_t millis, uint32_t tick, uint16_t fraction);

/* At most DPR_HOST_FRAMES / 16 readings. */
void dpr_host_poll(dpr_host_t *host, uint32_t millis, const dpr_reading_t *readings, size_t count);

/* Set the fault of the hardware; 0: none. */
void dpr_host_set_fault(dpr_host_t *host, uint8_t fault);

void dpr_host_note_dropped(dpr_host_t *host, uint16_t samples);

/* Move the waiting frames (at most DPR_HOST_FRAMES) to `frames`; return their number. */
size_t dpr_host_take(dpr_host_t *host, dpr_frame_t *frames);

/* Return the actions since the last call. */
dpr_actions_t dpr_host_actions(dpr_host_t *host);

uint8_t dpr_host_state(const dpr_host_t *host);
bool dpr_host_latched(const dpr_host_t *host);
uint32_t dpr_host_next_tick(const dpr_host_t *host);

/* Decode a chunk of a byte stream; `frames` has space for one frame per five bytes. Return the number of frames. */
size_t dpr_host_decode(dpr_decoder_t *decoder, const uint8_t *data, size_t length, dpr_frame_t *frames);

/* Return the number of refused packets by cause. */
void dpr_host_errors(const dpr_decoder_t *decoder, uint32_t *crc, uint32_t *framing);

#endif
