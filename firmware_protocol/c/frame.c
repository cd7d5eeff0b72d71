#include "frame.h"

#include <string.h>

uint16_t dpr_crc16(const uint8_t *data, size_t length)
{
    uint32_t crc = 0xFFFFu;
    for (size_t i = 0; i < length; i++) {
        crc ^= (uint32_t)data[i] << 8;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc & 0x8000u) ? (crc << 1) ^ 0x1021u : crc << 1;
        }
    }
    return (uint16_t)(crc & 0xFFFFu);
}

static void put_u16(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)(value >> 8);
}

static uint16_t get_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | (uint16_t)(at[1] << 8));
}

/* COBS for fewer than 254 bytes: every zero is replaced by the distance to the next zero. */
static size_t stuff(const uint8_t *body, size_t length, uint8_t *line)
{
    size_t code_at = 0, out = 1;
    for (size_t i = 0; i < length; i++) {
        if (body[i] != 0) {
            line[out++] = body[i];
        } else {
            line[code_at] = (uint8_t)(out - code_at);
            code_at = out++;
        }
    }
    line[code_at] = (uint8_t)(out - code_at);
    line[out++] = 0;
    return out;
}

/* Decode COBS without its final zero; return 0 if the bytes are not COBS. */
static size_t unstuff(const uint8_t *packet, size_t length, uint8_t *body)
{
    size_t at = 0, out = 0;
    while (at < length) {
        size_t code = packet[at];
        if (code > length - at) {
            return 0;
        }
        memcpy(&body[out], &packet[at + 1], code - 1);
        out += code - 1;
        at += code;
        if (at < length) {
            body[out++] = 0;
        }
    }
    return out;
}

size_t dpr_frame_encode(const dpr_frame_t *frame, uint8_t line[DPR_MAX_ENCODED])
{
    uint8_t body[DPR_MAX_PACKET];
    size_t length = 2u + frame->length;
    put_u16(body, frame->id);
    memcpy(&body[2], frame->data, frame->length);
    put_u16(&body[length], dpr_crc16(body, length));
    return stuff(body, length + 2u, line);
}

static bool decode(dpr_decoder_t *decoder, size_t length, dpr_frame_t *frame)
{
    uint8_t body[DPR_MAX_PACKET];
    size_t size = unstuff(decoder->packet, length, body);
    if (size < DPR_MIN_PACKET) {
        decoder->framing_errors++;
        return false;
    }
    if (dpr_crc16(body, size - 2u) != get_u16(&body[size - 2u])) {
        decoder->crc_errors++;
        return false;
    }
    if (get_u16(body) > DPR_MAX_ID) {
        decoder->framing_errors++;
        return false;
    }
    frame->id = get_u16(body);
    frame->length = (uint8_t)(size - DPR_MIN_PACKET);
    memset(frame->data, 0, sizeof frame->data);
    memcpy(frame->data, &body[2], frame->length);
    return true;
}

bool dpr_decoder_push(dpr_decoder_t *decoder, uint8_t byte, dpr_frame_t *frame)
{
    if (byte == 0) {
        size_t length = decoder->length;
        decoder->length = 0;
        decoder->skipping = false;
        return length > 0 && decode(decoder, length, frame);
    }
    if (decoder->skipping) {
        return false;
    }
    if (decoder->length == sizeof decoder->packet) {
        decoder->framing_errors++;
        decoder->skipping = true;
        decoder->length = 0;
        return false;
    }
    decoder->packet[decoder->length++] = byte;
    return false;
}
