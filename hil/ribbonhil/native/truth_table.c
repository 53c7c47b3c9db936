/* Interpolates a truth table in time. */
#include "truth_table.h"

#include <math.h>

static uint32_t row_index(const struct truth_table *table, int64_t row) {
    int64_t rows = (int64_t)table->rows;
    if (table->periodic) {
        row %= rows;
        return (uint32_t)(row < 0 ? row + rows : row);
    }
    return (uint32_t)(row < 0 ? 0 : row >= rows ? rows - 1 : row);
}

static void interpolate(const struct truth_table *table, const double *values, uint32_t slot, double t_s,
                        double out[3]) {
    double place = t_s / table->step_s;
    double last = (double)table->rows - 1.0;
    if (!table->periodic && place > last) {
        place = last;
    }
    double below = floor(place);
    double u = place - below;
    const double weight[4] = {
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    };
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = 0.0;
    }
    for (int i = 0; i < 4; i++) {
        uint32_t row = row_index(table, (int64_t)below + i - 1);
        const double *value = values + ((uint64_t)row * table->slots + slot) * 3u;
        for (int axis = 0; axis < 3; axis++) {
            out[axis] += weight[i] * value[axis];
        }
    }
}

void truth_table_specific_force(const struct truth_table *table, uint32_t slot, double t_s,
                                double out_mps2[3]) {
    interpolate(table, table->specific_force_mps2, slot, t_s, out_mps2);
}

void truth_table_field(const struct truth_table *table, uint32_t slot, double t_s, double out_ut[3]) {
    interpolate(table, table->field_ut, slot, t_s, out_ut);
}
