/* Protocol rules of a device, without its hardware. Inputs are frames and the time; outputs are frames and a task.
 *
 * The rules are those of firmware_protocol/session.py and device_role.py; traces.json tests both.
 */
#ifndef DPR_SESSION_H
#define DPR_SESSION_H

#include "messages.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DPR_LEASE_MS 500u /* without a message from its host for this time, a device stops streaming */
#define DPR_REMEMBERED 16u /* answers stored for repetition; a host has only one pending command */

/* Tasks that the owner of a session must carry out. */
typedef enum {
    DPR_DO_NOTHING,
    DPR_DO_HOLD,    /* close the latch for `pose` */
    DPR_DO_STREAM,  /* restart the tick at 0, at `rate_hz` */
    DPR_DO_RELEASE, /* open the latch and send EVENT RELEASED */
    DPR_DO_STOP,    /* return to the default rate */
    DPR_DO_PONG     /* answer the PING `ping` with the tick */
} dpr_task_t;

typedef struct {
    dpr_frame_t frames[3u + DPR_INFO_PAGES];
    uint8_t count;
    dpr_task_t task;
    uint8_t pose;
    uint16_t rate_hz;
    uint16_t ping;
} dpr_answer_t;

typedef struct {
    uint8_t command, token;
    uint8_t refusal; /* a NAK code, 0 for ACK */
} dpr_verdict_t;

typedef struct {
    const dpr_identity_t *identity;
    uint8_t state, fault;
    bool latched, greeted;
    uint32_t heard_ms;
    dpr_verdict_t verdicts[DPR_REMEMBERED];
    uint8_t remembered, oldest;
} dpr_session_t;

void dpr_session_start(dpr_session_t *session, const dpr_identity_t *identity);

bool dpr_session_streams(const dpr_session_t *session);

/* Process a received frame. Damaged frames and frames for other nodes are ignored. */
void dpr_session_receive(dpr_session_t *session, const dpr_frame_t *frame, uint32_t now_ms, dpr_answer_t *answer);

/* Stop streaming if the host was silent for DPR_LEASE_MS. The latch keeps its state. */
void dpr_session_check_lease(dpr_session_t *session, uint32_t now_ms, uint32_t tick, dpr_answer_t *answer);

/* Stop on a fault. The latch keeps its state. */
void dpr_session_fault(dpr_session_t *session, uint8_t fault, uint32_t tick, dpr_answer_t *answer);

#ifdef __cplusplus
}
#endif

#endif
