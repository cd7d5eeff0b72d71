/* Generated from dpr.dbc by generate.py. */
#ifndef DPR_SCHEMA_H
#define DPR_SCHEMA_H

#define DPR_PROTOCOL_MAJOR 1u
#define DPR_PROTOCOL_MINOR 2u
#define DPR_SCHEMA_HASH 0x709155C8u

#endif
