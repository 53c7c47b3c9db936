/* Vectors to matrix to quaternion. */
#ifndef QUATERNION_H
#define QUATERNION_H

/* The quaternion [w, x, y, z] that turns node vectors into world vectors (east, north, up), given the unit
 * vectors of north and up in the node's frame, orthogonal to each other. w is not negative. */
void quaternion_from_north_up(const float north[3], const float up[3], float q_world_node[4]);

#endif
