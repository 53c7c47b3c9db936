/* Which of two solutions is right, told by what stays continuous along the ribbon. */
#include "branch.h"

#include <stddef.h>

#include "vec3.h"

static float step_cost(const float from[3], const float to[3], float tolerance_squared, float cost_max) {
    const float cost = vec3_distance_squared(from, to) / tolerance_squared;
    return cost < cost_max ? cost : cost_max;
}

void branch_choose(const struct branch_node nodes[RIBBON_NODE_COUNT], float tolerance, float cost_max,
                   uint8_t chosen[RIBBON_NODE_COUNT]) {
    uint8_t best_before[RIBBON_NODE_COUNT][2];
    float total[2] = {0.0f, 0.0f}; /* of the best path to each solution of `before` */
    const struct branch_node *before = NULL;
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const struct branch_node *const node = &nodes[k];
        float total_here[2] = {0.0f, 0.0f};
        for (unsigned i = 0; i < node->count; i++) {
            float least = 0.0f;
            best_before[k][i] = 0u;
            for (unsigned j = 0; before != NULL && j < before->count; j++) {
                const float path =
                    total[j] + step_cost(before->field[j], node->field[i], tolerance * tolerance, cost_max);
                if (j == 0u || path < least) {
                    least = path;
                    best_before[k][i] = (uint8_t)j;
                }
            }
            total_here[i] = least + node->cost[i];
        }
        if (node->count > 0u) {
            total[0] = total_here[0];
            total[1] = total_here[1];
            before = node;
        }
    }

    uint8_t solution = before != NULL && before->count == 2u && total[1] < total[0] ? 1u : 0u;
    for (unsigned k = RIBBON_NODE_COUNT; k-- > 0u;) {
        chosen[k] = 0u;
        if (nodes[k].count == 0u)
            continue;
        chosen[k] = solution;
        solution = best_before[k][solution];
    }
}
