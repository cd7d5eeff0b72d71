#include "host.h"

#include <string.h>

/* Replace the version in a sent INFO by the claimed one. */
static void restate(const dpr_host_t *host, dpr_frame_t *info)
{
    struct dpr_info_t page = {0};
    dpr_info_unpack(&page, info->data, info->length);
    if (page.page == 0) {
        page.major = (uint8_t)(page.major + host->major_shift);
        page.schema_hash += host->schema_shift;
        dpr_info_pack(info->data, &page, DPR_MAX_DATA);
    }
}

/* Replace the claimed version in a received HELLO by that of this firmware. */
static void translate(const dpr_host_t *host, dpr_frame_t *hello)
{
    struct dpr_hello_t message;
    if (hello->length == DPR_HELLO_LENGTH && dpr_hello_unpack(&message, hello->data, hello->length) == 0) {
        message.major = (uint8_t)(message.major - host->major_shift);
        message.schema_hash -= host->schema_shift;
        dpr_hello_pack(hello->data, &message, DPR_MAX_DATA);
    }
}

uint32_t hal_millis(void *port)
{
    return ((const dpr_host_t *)port)->millis;
}

void hal_hold(void *port, uint8_t pose)
{
    dpr_actions_t *actions = &((dpr_host_t *)port)->actions;
    actions->hold = true;
    actions->pose = pose;
}

uint32_t hal_release(void *port)
{
    dpr_host_t *host = port;
    host->actions.release = true;
    host->actions.release_tick = host->device.next_tick;
    return host->actions.release_tick;
}

void hal_start_ticks(void *port, uint16_t rate_hz)
{
    dpr_host_t *host = port;
    host->waiting = 0;
    host->actions.start_ticks = true;
    host->actions.rate_hz = rate_hz;
}

bool hal_next_reading(void *port, dpr_reading_t *reading)
{
    dpr_host_t *host = port;
    if (host->waiting == 0) {
        return false;
    }
    *reading = *host->readings++;
    host->waiting--;
    return true;
}

void hal_time(void *port, uint32_t *tick, uint16_t *fraction)
{
    const dpr_host_t *host = port;
    *tick = host->tick;
    *fraction = host->fraction;
}

bool hal_send(void *port, const dpr_frame_t *frame)
{
    dpr_host_t *host = port;
    if (host->count == DPR_HOST_FRAMES) {
        return false;
    }
    dpr_frame_t *sent = &host->frames[host->count++];
    *sent = *frame;
    if ((sent->id & DPR_NUMBER_MASK) == DPR_INFO_FRAME_ID) {
        restate(host, sent);
    }
    return true;
}

uint8_t hal_fault(void *port)
{
    return ((const dpr_host_t *)port)->fault;
}

size_t dpr_host_size(void)
{
    return sizeof(dpr_host_t);
}

size_t dpr_host_decoder_size(void)
{
    return sizeof(dpr_decoder_t);
}

void dpr_host_start(dpr_host_t *host, const dpr_identity_t *identity)
{
    memset(host, 0, sizeof *host);
    host->identity = *identity;
    dpr_device_start(&host->device, &host->identity, host);
}

void dpr_host_claim(dpr_host_t *host, uint8_t major, uint32_t schema_hash)
{
    host->major_shift = (uint8_t)(major - DPR_PROTOCOL_MAJOR);
    host->schema_shift = schema_hash - DPR_SCHEMA_HASH;
}

void dpr_host_receive(
    dpr_host_t *host, const dpr_frame_t *frame, uint32_t millis, uint32_t tick, uint16_t fraction)
{
    host->millis = millis;
    host->tick = tick;
    host->fraction = fraction;
    dpr_frame_t received = *frame;
    if ((received.id & DPR_NUMBER_MASK) == DPR_HELLO_FRAME_ID) {
        translate(host, &received);
    }
    dpr_device_receive(&host->device, &received);
}

void dpr_host_poll(dpr_host_t *host, uint32_t millis, const dpr_reading_t *readings, size_t count)
{
    host->millis = millis;
    host->readings = readings;
    host->waiting = count;
    dpr_device_poll(&host->device);
}

void dpr_host_set_fault(dpr_host_t *host, uint8_t fault)
{
    host->fault = fault;
}

void dpr_host_note_dropped(dpr_host_t *host, uint16_t samples)
{
    dpr_device_note_dropped(&host->device, samples);
}

size_t dpr_host_take(dpr_host_t *host, dpr_frame_t *frames)
{
    size_t count = host->count;
    memcpy(frames, host->frames, count * sizeof *frames);
    host->count = 0;
    return count;
}

dpr_actions_t dpr_host_actions(dpr_host_t *host)
{
    dpr_actions_t actions = host->actions;
    memset(&host->actions, 0, sizeof host->actions);
    return actions;
}

uint8_t dpr_host_state(const dpr_host_t *host)
{
    return host->device.session.state;
}

bool dpr_host_latched(const dpr_host_t *host)
{
    return host->device.session.latched;
}

uint32_t dpr_host_next_tick(const dpr_host_t *host)
{
    return host->device.next_tick;
}

size_t dpr_host_decode(dpr_decoder_t *decoder, const uint8_t *data, size_t length, dpr_frame_t *frames)
{
    size_t count = 0;
    for (size_t i = 0; i < length; i++) {
        if (dpr_decoder_push(decoder, data[i], &frames[count])) {
            count++;
        }
    }
    return count;
}

void dpr_host_errors(const dpr_decoder_t *decoder, uint32_t *crc, uint32_t *framing)
{
    *crc = decoder->crc_errors;
    *framing = decoder->framing_errors;
}
