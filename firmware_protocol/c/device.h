/* A device: session, hardware, a sample at every tick, and ten reports per second.
 *
 * The whole state is in the dpr_device_t, so a program can contain several devices, each with its own `port`.
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

/* Initialise a device: no handshake yet, latch open, ticks at the default rate. */
void dpr_device_start(dpr_device_t *device, const dpr_identity_t *identity, void *port);

/* Process a received frame. */
void dpr_device_receive(dpr_device_t *device, const dpr_frame_t *frame);

/* Check lease and faults, and send the samples and reports of the readings since the last call. */
void dpr_device_poll(dpr_device_t *device);

/* Count dropped samples, for a port that accepts every frame and detects later that there was no space. */
void dpr_device_note_dropped(dpr_device_t *device, uint16_t samples);

#ifdef __cplusplus
}
#endif

#endif
