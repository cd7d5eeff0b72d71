/* What the core asks of a board: all that has to be written to port it.
 *
 * A port makes one dpr_device_t, calls dpr_device_receive() for every frame that arrives and dpr_device_poll() at least
 * every few milliseconds, both from the same thread or priority. No function here may wait. `port` is the pointer given
 * to dpr_device_start().
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

/* The multi-turn counters of arm, inner and outer rod, latched together at one tick. */
typedef struct {
    uint32_t tick;
    int32_t counts[DPR_JOINTS];
    int16_t torques[DPR_TORQUE_KINDS][2]; /* of joint 1 and 2, in the unit of the identity; of no meaning without */
    int32_t inputs[DPR_TORQUE_KINDS];     /* of the drive of the arm, likewise */
} dpr_reading_t;

/* Milliseconds of a clock that never jumps; may wrap. */
uint32_t hal_millis(void *port);

/* Engage the latch. `pose` is the number of the pose to show the operator, counted from 1; 0: none. */
void hal_hold(void *port, uint8_t pose);

/* Open the latch now; the tick of the first reading after that instant. */
uint32_t hal_release(void *port);

/* Restart the tick at 0 and latch the counters at every tick from now on. Readings still waiting are thrown away. */
void hal_start_ticks(void *port, uint16_t rate_hz);

/* The next waiting reading, oldest first; false when there is none. A tick whose reading was lost is left out. */
bool hal_next_reading(void *port, dpr_reading_t *reading);

/* The tick that has passed and the part of the next that has, in 1/65536. */
void hal_time(void *port, uint32_t *tick, uint16_t *fraction);

/* Queue a frame for the link; false when there is no room for all of it. */
bool hal_send(void *port, const dpr_frame_t *frame);

/* The fault the hardware has now, by its number in dpr.dbc; 0 none. */
uint8_t hal_fault(void *port);

#ifdef __cplusplus
}
#endif

#endif
