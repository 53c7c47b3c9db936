/* Dense linear algebra of small symmetric matrices. Nearly all of it is done in tiles of sums that stay in
 * registers; matrices have whole tiles in memory, and what a tile holds beyond n is never used. */
#include <string.h>

#include "motion_internal.h"

enum { STRIDE = RIBBON_MOTION_MATRIX_MAX, HEIGHT = 6, LANES = 4, WIDTH = 2 * LANES };
_Static_assert(STRIDE % HEIGHT == 0 && STRIDE % WIDTH == 0, "a matrix consists of whole tiles");

typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

/* Sums of a tile: over k < count of left[r * across + k * along] * right[k * STRIDE + c]. */
PART void sum_tile(const double *left, size_t across, size_t along, const double *right, size_t count,
                   lanes sum[HEIGHT][2]) {
    for (size_t r = 0; r < HEIGHT; r++)
        sum[r][0] = sum[r][1] = (lanes){0.0};
    for (size_t k = 0; k < count; k++) {
        const lanes *row = (const lanes *)(right + k * STRIDE);
        lanes x = row[0], y = row[1];
        for (size_t r = 0; r < HEIGHT; r++) {
            double a = left[r * across + k * along];
            sum[r][0] += a * x;
            sum[r][1] += a * y;
        }
    }
}

PART void store_tile(lanes sum[HEIGHT][2], double *out) {
    for (size_t r = 0; r < HEIGHT; r++) {
        lanes *row = (lanes *)(out + r * STRIDE);
        row[0] = sum[r][0];
        row[1] = sum[r][1];
    }
}

/* out = from - sums. */
PART void store_rest(lanes sum[HEIGHT][2], const double *from, double *out) {
    for (size_t r = 0; r < HEIGHT; r++) {
        const lanes *before = (const lanes *)(from + r * STRIDE);
        lanes *row = (lanes *)(out + r * STRIDE);
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

/* a = transpose(u) u; the upper triangle of u is used. */
PART bool factor(size_t n, const motion_matrix a, motion_matrix u) {
    for (size_t first = 0; first < n; first += HEIGHT) {
        size_t rows = smaller(HEIGHT, n - first);
        for (size_t j = tile_start(first); j < n; j += WIDTH) {
            lanes sum[HEIGHT][2];
            sum_tile(&u[0][first], 1, STRIDE, &u[0][j], first, sum);
            store_rest(sum, &a[first][j], &u[first][j]);
        }
        for (size_t i = first; i < first + rows; i++) {
            for (size_t k = first; k < i; k++)
                subtract_row(u[i], u[k][i], u[k], i, n);
            if (!(u[i][i] > 0.0) || !isfinite(u[i][i]))
                return false;
            scale_row(u[i], 1.0 / sqrt(u[i][i]), i, n);
        }
    }
    return true;
}

/* x = inverse(transpose(u)), a lower triangle, with zeros up to the end of the tiles on the diagonal. */
PART void invert_factor(size_t n, const motion_matrix u, motion_matrix x) {
    for (size_t first = 0; first < n; first += HEIGHT) {
        size_t rows = smaller(HEIGHT, n - first);
        for (size_t j = 0; j < first + rows; j += WIDTH) {
            lanes sum[HEIGHT][2];
            size_t begin = smaller(j, first);
            sum_tile(&u[begin][first], 1, STRIDE, &x[begin][j], first - begin, sum);
            for (size_t r = 0; r < HEIGHT; r++)
                sum[r][0] = -sum[r][0], sum[r][1] = -sum[r][1];
            store_tile(sum, &x[first][j]);
        }
        for (size_t i = first; i < first + rows; i++) {
            x[i][i] = 1.0;
            for (size_t j = i + 1; j < tile_end(first + rows - 1); j++)
                x[i][j] = 0.0;
            for (size_t k = first; k < i; k++)
                subtract_row(x[i], u[k][i], x[k], 0, i);
            scale_row(x[i], 1.0 / u[i][i], 0, i + 1);
        }
    }
}

WIDE bool motion_invert(size_t n, const motion_matrix a, motion_matrix out, motion_matrix workspace) {
    if (!factor(n, a, out))
        return false;
    invert_factor(n, out, workspace);
    for (size_t i = 0; i < n; i += HEIGHT)
        for (size_t j = tile_start(i); j < n; j += WIDTH) {
            lanes sum[HEIGHT][2];
            /* Rows above the diagonal tile hold nothing in its columns. */
            sum_tile(&workspace[j][i], 1, STRIDE, &workspace[j][j], n - j, sum);
            store_tile(sum, &out[i][j]);
        }
    mirror(n, out);
    return true;
}

WIDE void motion_gram(size_t n, size_t count, const double (*rows)[STRIDE], motion_matrix out) {
    for (size_t j = 0; j < n; j += WIDTH)
        for (size_t i = 0; i < smaller(n, j + WIDTH); i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(&rows[0][i], 1, STRIDE, &rows[0][j], count, sum);
            store_tile(sum, &out[i][j]);
        }
}

WIDE void motion_product(size_t n, const motion_matrix a, const motion_matrix b, motion_matrix out) {
    for (size_t j = 0; j < n; j += WIDTH)
        for (size_t i = 0; i < n; i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(a[i], STRIDE, 1, &b[0][j], n, sum);
            store_tile(sum, &out[i][j]);
        }
}

WIDE void motion_symmetric_product(size_t n, const motion_matrix a, const motion_matrix b,
                                   motion_matrix out) {
    for (size_t j = 0; j < n; j += WIDTH)
        for (size_t i = 0; i < smaller(n, j + WIDTH); i += HEIGHT) {
            lanes sum[HEIGHT][2];
            sum_tile(a[i], STRIDE, 1, &b[0][j], n, sum);
            store_tile(sum, &out[i][j]);
        }
    mirror(n, out);
}

/* a v; in partial sums, as a compiler may not reorder one. */
PART double sum_row(const double *a, const double *v, size_t first, size_t last) {
    double s[WIDTH] = {0.0};
    size_t j = first;
    for (; j + WIDTH <= last; j += WIDTH)
        for (size_t k = 0; k < WIDTH; k++)
            s[k] += a[j + k] * v[j + k];
    for (; j < last; j++)
        s[0] += a[j] * v[j];
    return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

WIDE double motion_trace(size_t n, const motion_matrix a, const motion_matrix b) {
    double diagonal = 0.0, above = 0.0;
    for (size_t i = 0; i < n; i++) {
        diagonal += a[i][i] * b[i][i];
        above += sum_row(a[i], b[i], i + 1, n);
    }
    return diagonal + 2.0 * above;
}

WIDE void motion_apply(size_t n, const motion_matrix a, const double *v, double *out) {
    for (size_t i = 0; i < n; i++)
        out[i] = sum_row(a[i], v, 0, n);
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

/* Cramer's rule. */
double motion_quadratic(double s[3][3], const double e[3]) {
    double c0[3], c1[3], c2[3];
    cross(s[1], s[2], c0);
    cross(s[2], s[0], c1);
    cross(s[0], s[1], c2);
    double x = dot(e, c0), y = dot(e, c1), z = dot(e, c2);
    return (e[0] * x + e[1] * y + e[2] * z) / dot(s[0], c0);
}
