/* What the sensors of a ribbon truly feel at any time: a table in equal steps of time, read between its rows.
 */
#ifndef TRUTH_TABLE_H
#define TRUTH_TABLE_H

#include <stdbool.h>
#include <stdint.h>

struct truth_table {
    const double *specific_force_mps2; /* [row][slot][axis], node frame */
    const double *field_ut;            /* the same for the magnetic field */
    uint32_t rows;                     /* at least 1; row k is at k * step_s */
    uint32_t slots;
    double step_s;
    bool periodic; /* after the last row comes the first; otherwise the first and the last row hold */
};

/* Cubic interpolation through the four nearest rows, continuous at any true time >= 0. */
void truth_table_specific_force(const struct truth_table *table, uint32_t slot, double t_s,
                                double out_mps2[3]);
void truth_table_field(const struct truth_table *table, uint32_t slot, double t_s, double out_ut[3]);

#endif
