/* Temporal smoothing of orientations: two equal first-order low-passes in a row, with a delay that is known.
 */
#include "internal.h"

/* Where an orientation's state holds the time of the last sample (NaN before the first), the sample, and the
 * outputs of both stages. */
enum { TIME = 0, INPUT = 1, FIRST = 5, SECOND = 9 };

/* Exact response of a low-pass to an input that runs straight from x0 to x1, so that a steady turn comes out
 * exactly tau late whatever the spacing of the samples. decay = exp(-dt / tau), mean = (1 - decay) tau / dt.
 */
static void low_pass(double decay, double mean, const double *x0, const double *x1, double *y) {
    for (size_t d = 0; d < 4; d++)
        y[d] = decay * y[d] + (mean - decay) * x0[d] + (1.0 - mean) * x1[d];
}

static void begin(double t, const double *q, double *state) {
    state[TIME] = t;
    for (size_t d = 0; d < 4; d++)
        state[INPUT + d] = state[FIRST + d] = state[SECOND + d] = q[d];
}

static void go_on(double t, double tau, const double *q, double *state) {
    double side = 0.0, x[4], first[4];
    for (size_t d = 0; d < 4; d++)
        side += state[INPUT + d] * q[d];
    for (size_t d = 0; d < 4; d++) {
        x[d] = side < 0.0 ? -q[d] : q[d];
        first[d] = state[FIRST + d];
    }
    double ratio = (t - state[TIME]) / tau, decay = exp(-ratio), mean = -expm1(-ratio) / ratio;
    low_pass(decay, mean, state + INPUT, x, state + FIRST);
    low_pass(decay, mean, first, state + FIRST, state + SECOND);
    state[TIME] = t;
    for (size_t d = 0; d < 4; d++)
        state[INPUT + d] = x[d];
}

int ribbon_smooth(size_t frames, size_t count, const double *t, double tau, const double *q,
                  const uint8_t *valid, double *state, double *smooth) {
    if (!isfinite(tau) || !(tau > 0.0))
        return RIBBON_ERROR_NOT_FINITE;
    for (size_t f = 0; f < frames; f++) {
        if (!isfinite(t[f]))
            return RIBBON_ERROR_NOT_FINITE;
        for (size_t i = 0; i < count; i++) {
            size_t at = count * f + i;
            double *own = state + RIBBON_SMOOTH_STATE * i, norm = 0.0;
            if (!valid || valid[at]) {
                if (t[f] <= own[TIME])
                    return RIBBON_ERROR_NOT_INCREASING;
                if (isnan(own[TIME]))
                    begin(t[f], q + 4 * at, own);
                else
                    go_on(t[f], tau, q + 4 * at, own);
            }
            for (size_t d = 0; d < 4; d++)
                norm += own[SECOND + d] * own[SECOND + d];
            for (size_t d = 0; d < 4; d++)
                smooth[4 * at + d] = own[SECOND + d] / sqrt(norm);
        }
    }
    return 0;
}
