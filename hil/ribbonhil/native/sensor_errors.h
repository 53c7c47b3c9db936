/* What a real part reads in place of the truth: gain, axes that are not where they should be, and bias.
 *
 * reading = (1 + scale_per_c (T - 25 C)) * matrix * v + bias + bias_per_c (T - 25 C), all of it in SI units
 * along the axes of the node frame: a part without errors has the identity and zeros. */
#ifndef SENSOR_ERRORS_H
#define SENSOR_ERRORS_H

#define SENSOR_ERRORS_REFERENCE_C 25.0

struct sensor_errors {
    double matrix[9]; /* row by row */
    double bias[3];   /* m/s^2 or uT, by part */
    double scale_per_c[3];
    double bias_per_c[3];
};

/* Replaces what is true by what the part reads at a temperature. */
void sensor_errors_apply(const struct sensor_errors *errors, double temperature_c, double v[3]);

#endif
