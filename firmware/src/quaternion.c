/* Vectors to matrix to quaternion. */
#include "quaternion.h"

#include "vec3.h"

void quaternion_from_north_up(const float north[3], const float up[3], float q_world_node[4]) {
    float east[3];
    vec3_cross(north, up, east);
    const float *const r[3] = {east, north,
                               up}; /* rows of the rotation matrix: world axes in the node's frame */

    /* Four times the square of each component; the largest is at least 1 and gives the others by division
     * (Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1(3), 1978). */
    const float squares[4] = {
        1.0f + r[0][0] + r[1][1] + r[2][2],
        1.0f + r[0][0] - r[1][1] - r[2][2],
        1.0f - r[0][0] + r[1][1] - r[2][2],
        1.0f - r[0][0] - r[1][1] + r[2][2],
    };
    unsigned largest = 0u;
    for (unsigned i = 1; i < 4u; i++)
        if (squares[i] > squares[largest])
            largest = i;

    const float wx = r[2][1] - r[1][2]; /* four times w x, and so on */
    const float wy = r[0][2] - r[2][0];
    const float wz = r[1][0] - r[0][1];
    const float xy = r[1][0] + r[0][1];
    const float xz = r[0][2] + r[2][0];
    const float yz = r[2][1] + r[1][2];
    float *const q = q_world_node;
    switch (largest) {
    case 0u:
        q[0] = squares[0], q[1] = wx, q[2] = wy, q[3] = wz;
        break;
    case 1u:
        q[0] = wx, q[1] = squares[1], q[2] = xy, q[3] = xz;
        break;
    case 2u:
        q[0] = wy, q[1] = xy, q[2] = squares[2], q[3] = yz;
        break;
    default:
        q[0] = wz, q[1] = xz, q[2] = yz, q[3] = squares[3];
        break;
    }
    const float norm = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const float scale = q[0] < 0.0f ? -1.0f / norm : 1.0f / norm;
    q[0] *= scale;
    q[1] *= scale;
    q[2] *= scale;
    q[3] *= scale;
}
