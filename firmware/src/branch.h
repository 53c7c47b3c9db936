/* Which of two solutions is right, told by what stays continuous along the ribbon. */
#ifndef BRANCH_H
#define BRANCH_H

#include <stdint.h>

#include "ribbon.h"

struct branch_node {
    uint8_t count;     /* solutions: 0, 1 or 2 */
    float cost[2];     /* of each, by itself: -2 log likelihood */
    float field[2][3]; /* what each says of the field in the node's frame, any unit */
};

/* The solution of each node, such that the sum of all costs and of the steps between neighbours is least
 * (Viterbi's algorithm). A step costs (difference of the fields / tolerance)^2, at most cost_max. */
void branch_choose(const struct branch_node nodes[RIBBON_NODE_COUNT], float tolerance, float cost_max,
                   uint8_t chosen[RIBBON_NODE_COUNT]);

#endif
