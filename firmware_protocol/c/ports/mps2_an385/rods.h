/* Two rods instead of a rig: independent damped pendulums, held by a latch or swinging.
 *
 *     omega' = K sin(theta) - C omega,    theta' = omega        (theta from upright)
 *
 * One step of the semi-implicit Euler method per tick, in float arithmetic. A host that compiles this file therefore
 * gets the same counts.
 */
#ifndef RODS_H
#define RODS_H

#include <stdbool.h>
#include <stdint.h>

#define RODS 2
#define COUNTS_PER_REV 16384

typedef struct {
    float theta[RODS], omega[RODS]; /* rad, rad/s */
    bool held;
} rods_t;

/* Place the rods near pose 1, 2 or 3 of configs/rigs/paper.toml; for any other number they hang. */
void rods_place(rods_t *rods, uint8_t pose);

void rods_let_go(rods_t *rods);

/* Simulate one tick of `period` s; the rods do not move while they are held. */
void rods_step(rods_t *rods, float period);

/* Counts of arm, inner and outer rod: 0 for hanging rods, the outer one relative to the inner one. */
void rods_read(const rods_t *rods, int32_t counts[3]);

#endif
