#include "messages.h"

static dpr_frame_t empty(uint8_t node, uint32_t number, uint8_t length)
{
    dpr_frame_t frame = {(uint16_t)((uint32_t)node << 6 | number), length, {0}};
    return frame;
}

dpr_frame_t dpr_event(uint8_t node, uint8_t kind, uint8_t detail, uint32_t tick)
{
    dpr_frame_t frame = empty(node, DPR_EVENT_FRAME_ID, DPR_EVENT_LENGTH);
    struct dpr_event_t event = {.kind = kind, .detail = detail, .tick = tick};
    dpr_event_pack(frame.data, &event, DPR_MAX_DATA);
    return frame;
}

static uint16_t low(int32_t count)
{
    return (uint16_t)((uint32_t)count & 0xFFFFu);
}

dpr_frame_t dpr_sample(uint8_t node, const dpr_reading_t *reading)
{
    dpr_frame_t frame = empty(node, DPR_SAMPLE_FRAME_ID, DPR_SAMPLE_LENGTH);
    struct dpr_sample_t sample = {
        .tick = (uint16_t)(reading->tick & 0xFFFFu),
        .position0 = low(reading->counts[0]),
        .position1 = low(reading->counts[1]),
        .position2 = low(reading->counts[2]),
    };
    dpr_sample_pack(frame.data, &sample, DPR_MAX_DATA);
    return frame;
}

/* `kind` is an index of `torques`. */
dpr_frame_t dpr_torque(uint8_t node, const dpr_reading_t *reading, uint8_t kind)
{
    dpr_frame_t frame = empty(node, DPR_TORQUE_FRAME_ID, DPR_TORQUE_LENGTH);
    struct dpr_torque_t torque = {
        .kind = (uint8_t)(DPR_TORQUE_KIND_MEASURED_CHOICE + kind),
        .tick = (uint16_t)(reading->tick & 0xFFFFu),
        .torque1 = reading->torques[kind][0],
        .torque2 = reading->torques[kind][1],
    };
    dpr_torque_pack(frame.data, &torque, DPR_MAX_DATA);
    return frame;
}

/* `kind` is an index of `inputs`. */
dpr_frame_t dpr_arm_input(uint8_t node, const dpr_reading_t *reading, uint8_t kind)
{
    dpr_frame_t frame = empty(node, DPR_ARM_INPUT_FRAME_ID, DPR_ARM_INPUT_LENGTH);
    struct dpr_arm_input_t input = {
        .kind = (uint8_t)(DPR_ARM_INPUT_KIND_MEASURED_CHOICE + kind),
        .tick = (uint16_t)(reading->tick & 0xFFFFu),
        .input = reading->inputs[kind],
    };
    dpr_arm_input_pack(frame.data, &input, DPR_MAX_DATA);
    return frame;
}

dpr_frame_t dpr_position(uint8_t node, const dpr_reading_t *reading, uint8_t joint)
{
    dpr_frame_t frame = empty(node, DPR_POSITION_FRAME_ID, DPR_POSITION_LENGTH);
    struct dpr_position_t position = {
        .joint = joint,
        .tick = (uint16_t)(reading->tick & 0xFFFFu),
        .position = reading->counts[joint],
    };
    dpr_position_pack(frame.data, &position, DPR_MAX_DATA);
    return frame;
}

dpr_frame_t dpr_status(uint8_t node, uint8_t state, uint8_t fault, bool latched, const dpr_counters_t *counters)
{
    dpr_frame_t frame = empty(node, DPR_STATUS_FRAME_ID, DPR_STATUS_LENGTH);
    struct dpr_status_t status = {
        .state = state,
        .fault = fault,
        .latched = latched,
        .overruns = counters->overruns,
        .dropped = counters->dropped,
        .sent = counters->sent,
    };
    dpr_status_pack(frame.data, &status, DPR_MAX_DATA);
    return frame;
}

dpr_frame_t dpr_pong(uint8_t node, uint16_t token, uint32_t tick, uint16_t fraction)
{
    dpr_frame_t frame = empty(node, DPR_PONG_FRAME_ID, DPR_PONG_LENGTH);
    struct dpr_pong_t pong = {.token = token, .tick = tick, .fraction = fraction};
    dpr_pong_pack(frame.data, &pong, DPR_MAX_DATA);
    return frame;
}

dpr_frame_t dpr_ack(uint8_t node, uint8_t command, uint8_t token)
{
    dpr_frame_t frame = empty(node, DPR_ACK_FRAME_ID, DPR_ACK_LENGTH);
    struct dpr_ack_t ack = {.command = command, .token = token};
    dpr_ack_pack(frame.data, &ack, DPR_MAX_DATA);
    return frame;
}

dpr_frame_t dpr_nak(uint8_t node, uint8_t command, uint8_t token, uint8_t code)
{
    dpr_frame_t frame = empty(node, DPR_NAK_FRAME_ID, DPR_NAK_LENGTH);
    struct dpr_nak_t nak = {.command = command, .token = token, .code = code};
    dpr_nak_pack(frame.data, &nak, DPR_MAX_DATA);
    return frame;
}

/* All fields; the page selects those that are packed. */
dpr_frame_t dpr_info(const dpr_identity_t *identity, uint8_t page)
{
    dpr_frame_t frame = empty(identity->node, DPR_INFO_FRAME_ID, DPR_INFO_LENGTH);
    struct dpr_info_t info = {
        .page = page,
        .major = DPR_PROTOCOL_MAJOR,
        .minor = DPR_PROTOCOL_MINOR,
        .schema_hash = DPR_SCHEMA_HASH,
        .firmware_major = identity->firmware[0],
        .firmware_minor = identity->firmware[1],
        .firmware_patch = identity->firmware[2],
        .simulated_time = identity->simulated_time,
        .uid_low = (uint32_t)(identity->uid & 0xFFFFFFFFu),
        .uid_high = (uint32_t)(identity->uid >> 32),
        .counts_per_rev0 = identity->counts_per_rev[0],
        .counts_per_rev1 = identity->counts_per_rev[1],
        .counts_per_rev2 = identity->counts_per_rev[2],
        .rate_max_hz = identity->rate_max_hz,
        .rate_default_hz = identity->rate_default_hz,
        .torque_unit = identity->torque_unit_uNm,
        .torque_measured = identity->torques[0],
        .torque_commanded = identity->torques[1],
        .input_unit = identity->input_unit,
        .input_measured = identity->inputs[0],
        .input_commanded = identity->inputs[1],
        .input_quantity = identity->input_quantity,
    };
    dpr_info_pack(frame.data, &info, DPR_MAX_DATA);
    return frame;
}
