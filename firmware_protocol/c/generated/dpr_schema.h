/* Generated from dpr.dbc by generate.py. */
#ifndef DPR_SCHEMA_H
#define DPR_SCHEMA_H

#define DPR_PROTOCOL_MAJOR 1u
#define DPR_PROTOCOL_MINOR 0u
#define DPR_SCHEMA_HASH 0xF72F4F73u

#endif
