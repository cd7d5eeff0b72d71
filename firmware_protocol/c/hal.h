/* Functions that a port implements for its board; the core needs nothing else.
 *
 * A port has one dpr_device_t. It calls dpr_device_receive() for every received frame, and dpr_device_poll() at least
 * every few milliseconds, both at the same priority level. No function of this file may block. `port` is the pointer
 * that was passed to dpr_device_start().
 */
#ifndef DPR_HAL_H
#define DPR_HAL_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DPR_JOINTS 3u
#define DPR_TORQUE_KINDS 2u /* measured and commanded, in this order */

/* Multi-turn counters of arm, inner and outer rod, captured together at one tick. */
typedef struct {
    uint32_t tick;
    int32_t counts[DPR_JOINTS];
    int16_t torques[DPR_TORQUE_KINDS][2]; /* of joints 1 and 2, in the unit of the identity; ignored without drives */
    int32_t inputs[DPR_TORQUE_KINDS];     /* of the drive of the arm, likewise */
} dpr_reading_t;

/* Return the milliseconds of a clock that never jumps; the value may wrap. */
uint32_t hal_millis(void *port);

/* Close the latch. `pose` is the number of the pose to show to the operator, counted from 1; 0: none. */
void hal_hold(void *port, uint8_t pose);

/* Open the latch now; return the tick of the first reading after this instant. */
uint32_t hal_release(void *port);

/* Restart the tick at 0, and capture the counters at every tick from now on. Discard all waiting readings. */
void hal_start_ticks(void *port, uint16_t rate_hz);

/* Remove the oldest waiting reading; return false if there is none. A lost reading leaves a gap in the ticks. */
bool hal_next_reading(void *port, dpr_reading_t *reading);

/* Return the last tick, and the elapsed fraction of the next one in units of 1/65536. */
void hal_time(void *port, uint32_t *tick, uint16_t *fraction);

/* Queue a frame for transmission; return false if there is no space for the whole frame. */
bool hal_send(void *port, const dpr_frame_t *frame);

/* Return the present fault of the hardware, as its number in dpr.dbc; 0: none. */
uint8_t hal_fault(void *port);

#ifdef __cplusplus
}
#endif

#endif
