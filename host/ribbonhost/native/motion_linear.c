/* Dense linear algebra of small symmetric matrices. Nearly all of it is done in tiles of sums that stay in
 * registers; matrices have whole tiles in memory, and what a tile holds beyond n is never used. */
#include <string.h>

#include "motion_internal.h"

enum { HEIGHT = 6, LANES = 4, WIDTH = 2 * LANES };
_Static_assert(RIBBON_MOTION_MATRIX_MAX % HEIGHT == 0 && RIBBON_MOTION_MATRIX_MAX % WIDTH == 0 &&
                   MOTION_ROW_MAX % HEIGHT == 0 && MOTION_ROW_MAX % WIDTH == 0,
               "arrays consist of whole tiles");

typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

/* Sums of a tile: over k < count of left[r * across + k * along] * right(k, c). */
PART void sum_tile(const double *left, size_t across, size_t along, const double *right, size_t stride,
                   size_t count, lanes sum[HEIGHT][2]) {
    for (size_t r = 0; r < HEIGHT; r++)
        sum[r][0] = sum[r][1] = (lanes){0.0};
    for (size_t k = 0; k < count; k++) {
        const lanes *row = (const lanes *)(right + k * stride);
        lanes x = row[0], y = row[1];
        for (size_t r = 0; r < HEIGHT; r++) {
            double a = left[r * across + k * along];
            sum[r][0] += a * x;
            sum[r][1] += a * y;
        }
    }
}

PART void store_tile(lanes sum[HEIGHT][2], double *out, size_t stride) {
    for (size_t r = 0; r < HEIGHT; r++) {
        lanes *row = (lanes *)(out + r * stride);
        row[0] = sum[r][0];
        row[1] = sum[r][1];
    }
}

/* out = from - sums. */
PART void store_rest(lanes sum[HEIGHT][2], const double *from, double *out, size_t stride) {
    for (size_t r = 0; r < HEIGHT; r++) {
        const lanes *before = (const lanes *)(from + r * stride);
        lanes *row = (lanes *)(out + r * stride);
        row[0] = before[0] - sum[r][0];
        row[1] = before[1] - sum[r][1];
    }
}

/* out[j] -= a * row[j] for j in [first, last). */
PART void subtract_row(double *restrict out, double a, const double *restrict row, size_t first,
                       size_t last) {
    for (size_t j = first; j < last; j++)
        out[j] -= a * row[j];
}

PART void scale_row(double *out, double a, size_t first, size_t last) {
    for (size_t j = first; j < last; j++)
        out[j] *= a;
}

PART size_t smaller(size_t a, size_t b) {
    return a < b ? a : b;
}

/* First column of the tile that column j lies in, and the first behind it. */
PART size_t tile_start(size_t j) {
    return j / WIDTH * WIDTH;
}

PART size_t tile_end(size_t j) {
    return tile_start(j) + WIDTH;
}

/* The upper triangle becomes the lower one, too. */
PART void mirror(size_t n, motion_matrix a) {
    for (size_t first = 0; first < n; first += WIDTH)
        for (size_t i = first; i < n; i++)
            for (size_t j = first; j < smaller(i, first + WIDTH); j++)
                a[i][j] = a[j][i];
}

/* u with a = transpose(u) u; the upper triangles are used, and u may be a. */
PART bool factor(size_t n, const double *a, double *u, size_t stride) {
    for (size_t first = 0; first < n; first += HEIGHT) {
        for (size_t j = tile_start(first); j < n; j += WIDTH) {
            lanes sum[HEIGHT][2];
            sum_tile(u + first, 1, stride, u + j, stride, first, sum);
            store_rest(sum, a + first * stride + j, u + first * stride + j, stride);
        }
        for (size_t i = first; i < smaller(first + HEIGHT, n); i++) {
            double *row = u + i * stride;
            for (size_t k = first; k < i; k++)
                subtract_row(row, u[k * stride + i], u + k * stride, i, n);
            if (!(row[i] > 0.0) || !isfinite(row[i]))
                return false;
            scale_row(row, 1.0 / sqrt(row[i]), i, n);
        }
    }
    return true;
}

/* x = inverse(transpose(u)), a lower triangle, with zeros up to the end of the tiles on the diagonal. */
PART void invert_factor(size_t n, const double *u, double *x, size_t stride) {
    for (size_t first = 0; first < n; first += HEIGHT) {
        size_t last = smaller(first + HEIGHT, n) - 1;
        for (size_t j = 0; j <= last; j += WIDTH) {
            lanes sum[HEIGHT][2];
            size_t begin = smaller(j, first);
            sum_tile(u + begin * stride + first, 1, stride, x + begin * stride + j, stride, first - begin,
                     sum);
            store_tile(sum, x + first * stride + j, stride);
        }
        for (size_t i = first; i <= last; i++) {
            double *row = x + i * stride;
            for (size_t j = 0; j < tile_end(last); j++)
                row[j] = j < i ? -row[j] : 0.0;
            row[i] = 1.0;
            for (size_t k = first; k < i; k++)
                subtract_row(row, u[k * stride + i], x + k * stride, 0, k + 1);
            scale_row(row, 1.0 / u[i * stride + i], 0, i + 1);
        }
    }
}

WIDE bool motion_invert(size_t n, const motion_matrix a, motion_matrix out, motion_matrix workspace) {
    const size_t stride = RIBBON_MOTION_MATRIX_MAX;
    if (!factor(n, a[0], out[0], stride))
        return false;
    invert_factor(n, out[0], workspace[0], stride);
    for (size_t i = 0; i < n; i += HEIGHT)
        for (size_t j = tile_start(i); j < n; j += WIDTH) {
            lanes sum[HEIGHT][2];
            /* Rows above the diagonal tile hold nothing in its columns. */
            sum_tile(&workspace[j][i], 1, stride, &workspace[j][j], stride, n - j, sum);
            store_tile(sum, &out[i][j], stride);
        }
    mirror(n, out);
    return true;
}

WIDE bool motion_whiten(size_t n, motion_spread s, motion_spread whitener) {
    if (!factor(n, s[0], s[0], MOTION_ROW_MAX))
        return false;
    invert_factor(n, s[0], whitener[0], MOTION_ROW_MAX);
    return true;
}

WIDE void motion_product(size_t rows, size_t inner, size_t columns, struct motion_view a,
                         struct motion_view b, struct motion_view out) {
    for (size_t j = 0; j < columns; j += WIDTH)
        for (size_t i = 0; i < rows; i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(a.at + i * a.stride, a.stride, 1, b.at + j, b.stride, inner, sum);
            store_tile(sum, out.at + i * out.stride + j, out.stride);
        }
}

WIDE void motion_lower_product(size_t rows, size_t columns, struct motion_view a, struct motion_view b,
                               struct motion_view out) {
    for (size_t j = 0; j < columns; j += WIDTH)
        for (size_t i = 0; i < rows; i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(a.at + i * a.stride, a.stride, 1, b.at + j, b.stride, smaller(i + HEIGHT, rows), sum);
            store_tile(sum, out.at + i * out.stride + j, out.stride);
        }
}

WIDE void motion_symmetric_product(size_t n, const motion_matrix a, const motion_matrix b,
                                   motion_matrix out) {
    const size_t stride = RIBBON_MOTION_MATRIX_MAX;
    for (size_t j = 0; j < n; j += WIDTH)
        for (size_t i = 0; i < smaller(n, j + WIDTH); i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(a[i], stride, 1, &b[0][j], stride, n, sum);
            store_tile(sum, &out[i][j], stride);
        }
    mirror(n, out);
}

WIDE void motion_subtract_squares(size_t n, size_t count, const motion_rows rows, const motion_matrix from,
                                  motion_matrix out) {
    const size_t stride = RIBBON_MOTION_MATRIX_MAX;
    for (size_t j = 0; j < n; j += WIDTH)
        for (size_t i = 0; i < smaller(n, j + WIDTH); i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(&rows[0][i], 1, stride, &rows[0][j], stride, count, sum);
            store_rest(sum, &from[i][j], &out[i][j], stride);
        }
    mirror(n, out);
}

WIDE double motion_dot(size_t n, const double *a, const double *b) {
    double s[WIDTH] = {0.0}; /* a compiler may not reorder one sum */
    size_t j = 0;
    for (; j + WIDTH <= n; j += WIDTH)
        for (size_t k = 0; k < WIDTH; k++)
            s[k] += a[j + k] * b[j + k];
    for (; j < n; j++)
        s[0] += a[j] * b[j];
    return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

void motion_apply(size_t n, const motion_matrix a, const double *v, double *out) {
    for (size_t i = 0; i < n; i++)
        out[i] = motion_dot(n, a[i], v);
}

void motion_transpose(size_t n, motion_matrix a) {
    for (size_t first = 0; first < n; first += WIDTH)
        for (size_t i = first; i < n; i++)
            for (size_t j = first; j < smaller(i, first + WIDTH); j++) {
                double swap = a[i][j];
                a[i][j] = a[j][i];
                a[j][i] = swap;
            }
}

void motion_transpose_rows(size_t count, size_t n, const motion_rows rows, motion_columns columns) {
    for (size_t first = 0; first < n; first += WIDTH)
        for (size_t i = 0; i < count; i++)
            for (size_t j = first; j < smaller(n, first + WIDTH); j++)
                columns[j][i] = rows[i][j];
}

/* Cramer's rule. */
double motion_quadratic(double s[3][3], const double e[3]) {
    double c0[3], c1[3], c2[3];
    cross(s[1], s[2], c0);
    cross(s[2], s[0], c1);
    cross(s[0], s[1], c2);
    double x = dot(e, c0), y = dot(e, c1), z = dot(e, c2);
    return (e[0] * x + e[1] * y + e[2] * z) / dot(s[0], c0);
}
