#include "rods.h"

#define PI 3.14159265f
#define C 0.2f /* 1/s */

static const float K[RODS] = {36.0f, 49.0f}; /* 1/s^2 */

static const float POSES[][RODS] = {{PI, PI}, {PI - 0.03f, 0.1f}, {0.1f, 0.1f}, {0.1f, PI - 0.03f}};

/* Sine with an error below 2e-4: Taylor series of order seven after reduction to -pi/2 .. pi/2. */
static float sine(float x)
{
    while (x > PI) {
        x -= 2.0f * PI;
    }
    while (x < -PI) {
        x += 2.0f * PI;
    }
    if (x > 0.5f * PI) {
        x = PI - x;
    } else if (x < -0.5f * PI) {
        x = -PI - x;
    }
    float s = x * x;
    return x * (1.0f - s / 6.0f * (1.0f - s / 20.0f * (1.0f - s / 42.0f)));
}

void rods_place(rods_t *rods, uint8_t pose)
{
    const float *target = POSES[pose < sizeof POSES / sizeof POSES[0] ? pose : 0];
    for (int rod = 0; rod < RODS; rod++) {
        rods->theta[rod] = target[rod];
        rods->omega[rod] = 0.0f;
    }
    rods->held = true;
}

void rods_let_go(rods_t *rods)
{
    rods->held = false;
}

void rods_step(rods_t *rods, float period)
{
    if (rods->held) {
        return;
    }
    for (int rod = 0; rod < RODS; rod++) {
        rods->omega[rod] += period * (K[rod] * sine(rods->theta[rod]) - C * rods->omega[rod]);
        rods->theta[rod] += period * rods->omega[rod];
    }
}

static int32_t counts_of(float angle)
{
    float counts = angle * ((float)COUNTS_PER_REV / (2.0f * PI));
    return (int32_t)(counts < 0.0f ? counts - 0.5f : counts + 0.5f);
}

void rods_read(const rods_t *rods, int32_t counts[3])
{
    counts[0] = 0;
    counts[1] = counts_of(rods->theta[0] - PI);
    counts[2] = counts_of(rods->theta[1] - rods->theta[0]);
}
