/* A device: the session acting on its hardware, samples at every tick, reports ten times a second.
 *
 * Everything is in the dpr_device_t; any number of them may live side by side, each with its own `port`.
 */
#ifndef DPR_DEVICE_H
#define DPR_DEVICE_H

#include "session.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    dpr_session_t session;
    dpr_counters_t counters;
    void *port;
    uint16_t rate_hz;
    uint32_t next_tick;   /* of the next reading */
    uint32_t report_tick; /* of the next report */
    uint32_t release_tick;
} dpr_device_t;

/* Powers up: not greeted, latch open, ticks at the default rate. */
void dpr_device_start(dpr_device_t *device, const dpr_identity_t *identity, void *port);

/* Obeys a frame off the link. */
void dpr_device_receive(dpr_device_t *device, const dpr_frame_t *frame);

/* Looks after lease and faults, and sends what the readings since the last call ask for. */
void dpr_device_poll(dpr_device_t *device);

/* For a port that takes every frame and finds only later that samples had no room. */
void dpr_device_note_dropped(dpr_device_t *device, uint16_t samples);

#ifdef __cplusplus
}
#endif

#endif
