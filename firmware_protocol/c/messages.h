/* Frames that a device sends, packed by the code generated from dpr.dbc. */
#ifndef DPR_MESSAGES_H
#define DPR_MESSAGES_H

#include "generated/dpr.h"
#include "generated/dpr_schema.h"
#include "hal.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DPR_INFO_PAGES 8u
#define DPR_NUMBER_MASK 0x3Fu /* bits of an identifier that select the message; the higher bits are the node */

enum {
    DPR_IDLE = DPR_STATUS_STATE_IDLE_CHOICE,
    DPR_HOLDING = DPR_STATUS_STATE_HOLDING_CHOICE,
    DPR_STREAMING = DPR_STATUS_STATE_STREAMING_CHOICE,
    DPR_RELEASED = DPR_STATUS_STATE_RELEASED_CHOICE,
    DPR_FAULT = DPR_STATUS_STATE_FAULT_CHOICE
};

/* Identity of a device, as sent in INFO, and its node. */
typedef struct {
    uint64_t uid;
    uint32_t counts_per_rev[DPR_JOINTS];
    uint16_t rate_max_hz;
    uint16_t rate_default_hz; /* of the tick while not streaming */
    uint8_t firmware[3];      /* major, minor, patch */
    uint8_t node;
    bool simulated_time;
    bool torques[DPR_TORQUE_KINDS]; /* known torques of the joint drives: measured, commanded */
    uint32_t torque_unit_uNm;
    bool inputs[DPR_TORQUE_KINDS]; /* known inputs of the arm's drive: measured, commanded */
    uint8_t input_quantity;        /* torque, current or voltage, as its number in dpr.dbc */
    uint32_t input_unit;           /* uN m, uA or uV */
} dpr_identity_t;

/* Counts since STREAM. */
typedef struct {
    uint16_t overruns; /* ticks without a reading */
    uint16_t dropped;  /* samples without space in the transmit buffer */
    uint16_t sent;
} dpr_counters_t;

dpr_frame_t dpr_event(uint8_t node, uint8_t kind, uint8_t detail, uint32_t tick);
dpr_frame_t dpr_sample(uint8_t node, const dpr_reading_t *reading);
dpr_frame_t dpr_torque(uint8_t node, const dpr_reading_t *reading, uint8_t kind);
dpr_frame_t dpr_arm_input(uint8_t node, const dpr_reading_t *reading, uint8_t kind);
dpr_frame_t dpr_position(uint8_t node, const dpr_reading_t *reading, uint8_t joint);
dpr_frame_t dpr_status(uint8_t node, uint8_t state, uint8_t fault, bool latched, const dpr_counters_t *counters);
dpr_frame_t dpr_pong(uint8_t node, uint16_t token, uint32_t tick, uint16_t fraction);
dpr_frame_t dpr_ack(uint8_t node, uint8_t command, uint8_t token);
dpr_frame_t dpr_nak(uint8_t node, uint8_t command, uint8_t token, uint8_t code);
dpr_frame_t dpr_info(const dpr_identity_t *identity, uint8_t page);

#ifdef __cplusplus
}
#endif

#endif
