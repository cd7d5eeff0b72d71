/* Two rods in place of a rig: each a damped pendulum for itself, held by a latch or swinging.
 *
 *     omega' = K sin(theta) - C omega,    theta' = omega        (theta from upright)
 *
 * A step of semi-implicit Euler per tick. Plain float arithmetic, so that a host that compiles this file gets the very
 * same counts.
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

/* The operator brings the rods near a pose of configs/rigs/paper.toml, from 1; hanging for any other number. */
void rods_place(rods_t *rods, uint8_t pose);

void rods_let_go(rods_t *rods);

/* One tick of `period` s; nothing moves while the rods are held. */
void rods_step(rods_t *rods, float period);

/* What the encoders of arm, inner and outer rod read: 0 hanging straight down, the outer one relative to the inner. */
void rods_read(const rods_t *rods, int32_t counts[3]);

#endif
