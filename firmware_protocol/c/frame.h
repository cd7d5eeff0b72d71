/* Frames on a byte stream: COBS(id | data | crc) 0x00 (docs/wire.md). */
#ifndef DPR_FRAME_H
#define DPR_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DPR_MAX_DATA 8u
#define DPR_MAX_ID 0x7FFu
#define DPR_MIN_PACKET 4u
#define DPR_MAX_PACKET (DPR_MIN_PACKET + DPR_MAX_DATA)
#define DPR_MAX_ENCODED (DPR_MAX_PACKET + 2u) /* with the final zero */

/* Frame of both links: an 11-bit identifier and at most eight bytes. */
typedef struct {
    uint16_t id;
    uint8_t length;
    uint8_t data[DPR_MAX_DATA];
} dpr_frame_t;

/* Decoder of a byte stream; initialise it with zeros. */
typedef struct {
    uint32_t crc_errors;     /* complete packets with a wrong CRC */
    uint32_t framing_errors; /* invalid packets: damaged COBS, too short, too long, or an identifier beyond 11 bits */
    uint8_t packet[DPR_MAX_ENCODED - 1u];
    uint8_t length;
    bool skipping;
} dpr_decoder_t;

/* CRC-16/IBM-3740: 0x29B1 for "123456789". */
uint16_t dpr_crc16(const uint8_t *data, size_t length);

/* Encode a frame for the line; return the number of bytes. */
size_t dpr_frame_encode(const dpr_frame_t *frame, uint8_t line[DPR_MAX_ENCODED]);

/* Process the next byte; return true if it completes a valid frame. */
bool dpr_decoder_push(dpr_decoder_t *decoder, uint8_t byte, dpr_frame_t *frame);

#ifdef __cplusplus
}
#endif

#endif
