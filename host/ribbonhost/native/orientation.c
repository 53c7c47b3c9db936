/* Orientations of nodes: their tangents and binormals, and the bridging of invalid ones. */
#include "internal.h"

void ribbon_directions(size_t count, const double *q, double *tangent, double *binormal) {
    for (size_t i = 0; i < count; i++) {
        double w = q[4 * i], x = q[4 * i + 1], y = q[4 * i + 2], z = q[4 * i + 3];
        double r = 2.0 / (w * w + x * x + y * y + z * z);
        if (tangent) {
            tangent[3 * i] = 1.0 - r * (y * y + z * z);
            tangent[3 * i + 1] = r * (x * y + w * z);
            tangent[3 * i + 2] = r * (x * z - w * y);
        }
        if (binormal) {
            binormal[3 * i] = r * (x * y - w * z);
            binormal[3 * i + 1] = 1.0 - r * (x * x + z * z);
            binormal[3 * i + 2] = r * (y * z + w * x);
        }
    }
}

/* For |v|^2 of a quaternion or direction. */
static int check_square(double square) {
    if (!isfinite(square))
        return RIBBON_ERROR_NOT_FINITE;
    return fabs(square - 1.0) > 1e-3 ? RIBBON_ERROR_NOT_UNIT : 0;
}

int ribbon_check_directions(size_t count, const double *v) {
    int error = 0;
    for (size_t i = 0; i < count && !error; i++)
        error = check_square(dot3(v + 3 * i, v + 3 * i));
    return error;
}

static double norm4(const double *q) {
    return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
}

static int check_quaternions(size_t count, const double *q, const uint8_t *valid) {
    for (size_t i = 0; i < count; i++) {
        if (valid && !valid[i])
            continue;
        int error = check_square(norm4(q + 4 * i));
        if (error)
            return error;
    }
    return 0;
}

/* Up to `wanted` valid nodes next to node k, in ascending order: half of them from either side where there
 * are. */
static size_t valid_neighbours(size_t nodes, const uint8_t *valid, size_t k, size_t wanted, size_t *at) {
    size_t before[4], after[4], n_before = 0, n_after = 0;
    for (size_t i = k; i-- > 0 && n_before < wanted;)
        if (valid[i])
            before[n_before++] = i;
    for (size_t i = k + 1; i < nodes && n_after < wanted; i++)
        if (valid[i])
            after[n_after++] = i;
    size_t half = wanted / 2;
    size_t take_before = n_after < half ? wanted - n_after : half;
    if (take_before > n_before)
        take_before = n_before;
    size_t take_after = n_after < wanted - take_before ? n_after : wanted - take_before;
    for (size_t i = 0; i < take_before; i++)
        at[i] = before[take_before - 1 - i];
    for (size_t i = 0; i < take_after; i++)
        at[take_before + i] = after[i];
    return take_before + take_after;
}

static void lagrange(size_t count, const size_t *at, const double *s, double x, double *weight) {
    for (size_t i = 0; i < count; i++) {
        weight[i] = 1.0;
        for (size_t j = 0; j < count; j++)
            if (j != i)
                weight[i] *= (x - s[at[j]]) / (s[at[i]] - s[at[j]]);
    }
}

size_t bridge_weights(size_t nodes, const double *s, const uint8_t *valid, size_t k, size_t *at,
                      double *weight) {
    size_t count = valid_neighbours(nodes, valid, k, 4, at);
    double x = s[k];
    if (at[0] > k || at[count - 1] < k) {
        /* Beyond the outermost valid node: linear, no further than the outermost two are apart, then
         * constant. */
        count = count < 2 ? count : 2;
        if (at[0] < k)
            valid_neighbours(nodes, valid, k, count, at);
        double reach = s[at[count - 1]] - s[at[0]];
        x = fmin(fmax(x, s[at[0]] - reach), s[at[count - 1]] + reach);
    }
    lagrange(count, at, s, x, weight);
    return count;
}

/* Weighted mean of the quaternions at some nodes, each on the side of the first, normalised. */
static void combine(size_t count, const size_t *at, const double *weight, const double *q, double *out) {
    const double *first = q + 4 * at[0];
    fill(out, 4, 0.0);
    for (size_t i = 0; i < count; i++) {
        const double *qi = q + 4 * at[i];
        double side = first[0] * qi[0] + first[1] * qi[1] + first[2] * qi[2] + first[3] * qi[3];
        for (size_t d = 0; d < 4; d++)
            out[d] += (side < 0.0 ? -weight[i] : weight[i]) * qi[d];
    }
    double scale = 1.0 / sqrt(norm4(out));
    for (size_t d = 0; d < 4; d++)
        out[d] *= scale;
}

static double angle_between(const double *a, const double *b) {
    double difference = 0.0, sum = 0.0;
    for (size_t d = 0; d < 4; d++) {
        difference += (a[d] - b[d]) * (a[d] - b[d]);
        sum += (a[d] + b[d]) * (a[d] + b[d]);
    }
    return 4.0 * asin(fmin(1.0, 0.5 * sqrt(fmin(difference, sum))));
}

/* Fills node k; returns the angle between the filling and a simpler one. */
static double bridge_node(size_t nodes, const double *s, const double *q, const uint8_t *valid, size_t k,
                          double *out) {
    size_t at[4] = {0};
    double weight[4];
    size_t count = bridge_weights(nodes, s, valid, k, at, weight);
    combine(count, at, weight, q, out);
    if (count < 2)
        return RIBBON_SPREAD_OF_ONE;
    double simple[4];
    bool inside = at[0] < k && at[count - 1] > k;
    if (inside && count > 2) {
        size_t before = count - 1;
        while (at[before] > k)
            before--;
        lagrange(2, at + before, s, s[k], weight);
        combine(2, at + before, weight, q, simple);
    } else {
        size_t nearest = inside ? (s[k] - s[at[0]] < s[at[1]] - s[k] ? 0 : 1) : (at[0] > k ? 0 : count - 1);
        combine(1, at + nearest, (const double[]){1.0}, q, simple);
    }
    return angle_between(out, simple);
}

int ribbon_bridge(size_t ribbons, size_t nodes, const double *s, const double *q, const uint8_t *valid,
                  double *bridged, double *spread) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    int error = check_quaternions(ribbons * nodes, q, valid);
    if (error)
        return error;
    int filled = 0;
    for (size_t r = 0; r < ribbons; r++) {
        const double *ribbon_q = q + 4 * nodes * r;
        const uint8_t *ribbon_valid = valid ? valid + nodes * r : NULL;
        double *out = bridged + 4 * nodes * r;
        bool any = !ribbon_valid;
        for (size_t k = 0; k < nodes && !any; k++)
            any = ribbon_valid[k];
        for (size_t k = 0; k < nodes; k++) {
            double node_spread = 0.0;
            if (!any) {
                fill(out + 4 * k, 4, node_spread = NAN);
            } else if (ribbon_valid && !ribbon_valid[k]) {
                node_spread = bridge_node(nodes, s, ribbon_q, ribbon_valid, k, out + 4 * k);
                filled++;
            } else {
                for (size_t d = 0; d < 4; d++)
                    out[4 * k + d] = ribbon_q[4 * k + d];
            }
            if (spread)
                spread[nodes * r + k] = node_spread;
        }
    }
    return filled;
}
