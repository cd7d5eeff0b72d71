#include "device.h"

#include <string.h>

#define REPORTS_HZ 10u

static uint8_t node_of(const dpr_device_t *device)
{
    return device->session.identity->node;
}

static bool emit(dpr_device_t *device, dpr_frame_t frame)
{
    return hal_send(device->port, &frame);
}

static void start_ticks(dpr_device_t *device, uint16_t rate_hz)
{
    device->rate_hz = rate_hz;
    device->next_tick = 0;
    device->report_tick = 0;
    hal_start_ticks(device->port, rate_hz);
}

static void send_released(dpr_device_t *device)
{
    emit(device, dpr_event(node_of(device), DPR_EVENT_KIND_RELEASED_CHOICE, 0, device->release_tick));
}

static void send_pong(dpr_device_t *device, uint16_t ping)
{
    uint32_t tick = 0;
    uint16_t fraction = 0;
    hal_time(device->port, &tick, &fraction);
    emit(device, dpr_pong(node_of(device), ping, tick, fraction));
}

static void carry_out(dpr_device_t *device, const dpr_answer_t *answer)
{
    for (uint8_t i = 0; i < answer->count; i++) {
        emit(device, answer->frames[i]);
    }
    switch (answer->task) {
    case DPR_DO_NOTHING:
        break;
    case DPR_DO_HOLD:
        hal_hold(device->port, answer->pose);
        break;
    case DPR_DO_STREAM:
        memset(&device->counters, 0, sizeof device->counters);
        start_ticks(device, answer->rate_hz);
        break;
    case DPR_DO_RELEASE:
        device->release_tick = hal_release(device->port);
        send_released(device);
        break;
    case DPR_DO_STOP:
        start_ticks(device, device->session.identity->rate_default_hz);
        break;
    case DPR_DO_PONG:
        send_pong(device, answer->ping);
        break;
    }
}

/* Send positions and status. Repeat RELEASED, so that a lost frame does not invalidate the swing. */
static void report(dpr_device_t *device, const dpr_reading_t *reading)
{
    const dpr_session_t *session = &device->session;
    for (uint8_t joint = 0; joint < DPR_JOINTS; joint++) {
        emit(device, dpr_position(node_of(device), reading, joint));
    }
    emit(device, dpr_status(node_of(device), session->state, session->fault, session->latched, &device->counters));
    if (session->state == DPR_RELEASED) {
        send_released(device);
    }
}

static bool report_due(dpr_device_t *device, uint32_t tick)
{
    uint32_t period = device->rate_hz < REPORTS_HZ ? 1u : device->rate_hz / REPORTS_HZ;
    if ((int32_t)(tick - device->report_tick) < 0) {
        return false;
    }
    device->report_tick = (tick / period + 1u) * period;
    return true;
}

static void send_sample(dpr_device_t *device, const dpr_reading_t *reading, uint32_t missed)
{
    dpr_counters_t *counters = &device->counters;
    counters->overruns = (uint16_t)(counters->overruns + missed);
    if (!emit(device, dpr_sample(node_of(device), reading))) {
        counters->dropped++;
        return;
    }
    counters->sent++;
    for (uint8_t kind = 0; kind < DPR_TORQUE_KINDS; kind++) {
        if (device->session.identity->torques[kind]) {
            emit(device, dpr_torque(node_of(device), reading, kind));
        }
        if (device->session.identity->inputs[kind]) {
            emit(device, dpr_arm_input(node_of(device), reading, kind));
        }
    }
}

static void take(dpr_device_t *device, const dpr_reading_t *reading)
{
    uint32_t missed = reading->tick - device->next_tick;
    bool streams = dpr_session_streams(&device->session);
    device->next_tick = reading->tick + 1u;
    if (report_due(device, reading->tick) && (streams || device->session.greeted)) {
        report(device, reading);
    }
    if (streams) {
        send_sample(device, reading, missed);
    }
}

void dpr_device_start(dpr_device_t *device, const dpr_identity_t *identity, void *port)
{
    memset(device, 0, sizeof *device);
    device->port = port;
    dpr_session_start(&device->session, identity);
    start_ticks(device, identity->rate_default_hz);
}

void dpr_device_receive(dpr_device_t *device, const dpr_frame_t *frame)
{
    dpr_answer_t answer;
    dpr_session_receive(&device->session, frame, hal_millis(device->port), &answer);
    carry_out(device, &answer);
}

void dpr_device_poll(dpr_device_t *device)
{
    dpr_answer_t answer;
    dpr_reading_t reading;
    dpr_session_check_lease(&device->session, hal_millis(device->port), device->next_tick, &answer);
    carry_out(device, &answer);
    uint8_t fault = hal_fault(device->port);
    if (fault != DPR_STATUS_FAULT_NONE_CHOICE && device->session.state != DPR_FAULT) {
        dpr_session_fault(&device->session, fault, device->next_tick, &answer);
        carry_out(device, &answer);
    }
    while (hal_next_reading(device->port, &reading)) {
        take(device, &reading);
    }
}

void dpr_device_note_dropped(dpr_device_t *device, uint16_t samples)
{
    device->counters.dropped = (uint16_t)(device->counters.dropped + samples);
    device->counters.sent = (uint16_t)(device->counters.sent - samples);
}
