/* Rotations as vectors, matrices and quaternions. */
#include "motion_internal.h"

void motion_exp(const double v[3], double out[9]) {
    double square = dot(v, v), angle = sqrt(square);
    /* Series below 1e-4 rad: the next terms are under 1e-17. */
    double a = square < 1e-8 ? 1.0 - square / 6.0 : sin(angle) / angle;
    double b = square < 1e-8 ? 0.5 - square / 24.0 : (1.0 - cos(angle)) / square;
    double c = 1.0 - b * square;
    out[0] = c + b * v[0] * v[0];
    out[4] = c + b * v[1] * v[1];
    out[8] = c + b * v[2] * v[2];
    out[1] = b * v[0] * v[1] - a * v[2];
    out[3] = b * v[0] * v[1] + a * v[2];
    out[2] = b * v[0] * v[2] + a * v[1];
    out[6] = b * v[0] * v[2] - a * v[1];
    out[5] = b * v[1] * v[2] - a * v[0];
    out[7] = b * v[1] * v[2] + a * v[0];
}

void motion_to_quaternion(const double m[9], double q[4]) {
    /* The largest component is computed from the diagonal, the others divide by it. */
    double d[4] = {1.0 + m[0] + m[4] + m[8], 1.0 + m[0] - m[4] - m[8], 1.0 - m[0] + m[4] - m[8],
                   1.0 - m[0] - m[4] + m[8]};
    int largest = 0;
    for (int i = 1; i < 4; i++)
        if (d[i] > d[largest])
            largest = i;
    double r = 2.0 * sqrt(d[largest]);
    double wx = (m[7] - m[5]) / r, wy = (m[2] - m[6]) / r, wz = (m[3] - m[1]) / r;
    double xy = (m[1] + m[3]) / r, xz = (m[2] + m[6]) / r, yz = (m[5] + m[7]) / r;
    double rows[4][4] = {
        {r / 4.0, wx, wy, wz}, {wx, r / 4.0, xy, xz}, {wy, xy, r / 4.0, yz}, {wz, xz, yz, r / 4.0}};
    for (int i = 0; i < 4; i++)
        q[i] = rows[largest][i];
}

void motion_from_quaternion(const double q[4], double m[9]) {
    double s = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double w = q[0], x = q[1], y = q[2], z = q[3];
    m[0] = 1.0 - s * (y * y + z * z);
    m[1] = s * (x * y - w * z);
    m[2] = s * (x * z + w * y);
    m[3] = s * (x * y + w * z);
    m[4] = 1.0 - s * (x * x + z * z);
    m[5] = s * (y * z - w * x);
    m[6] = s * (x * z - w * y);
    m[7] = s * (y * z + w * x);
    m[8] = 1.0 - s * (x * x + y * y);
}

void motion_log(const double m[9], double out[3]) {
    double q[4];
    motion_to_quaternion(m, q);
    double sign = q[0] < 0.0 ? -1.0 : 1.0;
    double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double scale = sine < 1e-9 ? 2.0 * sign : 2.0 * sign * atan2(sine, fabs(q[0])) / sine;
    for (int i = 0; i < 3; i++)
        out[i] = scale * q[i + 1];
}

void motion_turn(double root[9], const double v[3]) {
    double turn[9], product[9], q[4];
    motion_exp(v, turn);
    multiply3(turn, root, product);
    motion_to_quaternion(product, q);
    motion_from_quaternion(q, root);
}
