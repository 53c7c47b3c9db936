/* What a real part reads in place of the truth. */
#include "sensor_errors.h"

void sensor_errors_apply(const struct sensor_errors *errors, double temperature_c, double v[3]) {
    const double truth[3] = {v[0], v[1], v[2]};
    double warmer_c = temperature_c - SENSOR_ERRORS_REFERENCE_C;
    for (int axis = 0; axis < 3; axis++) {
        const double *row = errors->matrix + 3 * axis;
        double sensed = row[0] * truth[0] + row[1] * truth[1] + row[2] * truth[2];
        v[axis] = (1.0 + errors->scale_per_c[axis] * warmer_c) * sensed + errors->bias[axis] +
                  errors->bias_per_c[axis] * warmer_c;
    }
}
