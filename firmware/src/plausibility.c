/* Which readings do not fit in with those of their neighbours on the ribbon. */
#include "plausibility.h"

#include <math.h>
#include <stdint.h>

#include "vec3.h"

#define COUNT RIBBON_NODE_COUNT

/* Share of the size by which a reading may differ from what two neighbours on each side say, and from what
 * fewer say. A bend of 7 cm radius makes 0.04 and 0.36 of it. */
static const float TOLERANCE = 0.2f;
static const float TOLERANCE_AT_END = 0.4f;

/* The same of the length, which no bend changes, but what is left of scale and offset without calibration. */
static const float TOLERANCE_OF_LENGTH = 0.15f;

/* Accelerations of a shaken ribbon differ along it: so much more of what they make |reading| differ from
 * size. */
static const float TOLERANCE_MOVING = 0.5f;

/* So much less contradiction, in units of what there may be, makes one reading rather the culprit than one
 * nearer to where it was seen. */
static const float SILENCE = 0.15f;

/* Neighbours farther than this say nothing: three on one side are needed, or two on each. */
enum { REACH = 3, REACH_BETWEEN = 2, NEIGHBOURS_MAX = 4, MARKS_MAX = 4 };

struct check {
    const struct plausibility_input *input;
    float length[COUNT]; /* of the readings; 0 where it says nothing */
    bool trusted[COUNT];
};

struct neighbours {
    unsigned count;
    int offset[NEIGHBOURS_MAX]; /* from the sensor whose neighbours they are */
    float tolerance;            /* share of the size */
};

/* Adds the trusted sensors within reach on one side. */
static unsigned add_side(struct neighbours *neighbours, const struct check *check, unsigned i, int direction,
                         int reach) {
    unsigned count = 0u;
    for (int step = 1; step <= reach; step++) {
        const int j = (int)i + direction * step;
        if (j >= 0 && j < (int)COUNT && check->trusted[j]) {
            neighbours->offset[neighbours->count++] = direction * step;
            count++;
        }
    }
    return count;
}

/* The sensors whose readings say what that of sensor i should be; false if there are too few. */
static bool find_neighbours(struct neighbours *neighbours, const struct check *check, unsigned i) {
    neighbours->count = 0u;
    const unsigned below = add_side(neighbours, check, i, -1, REACH_BETWEEN);
    const unsigned above = add_side(neighbours, check, i, 1, REACH_BETWEEN);
    neighbours->tolerance = neighbours->count == NEIGHBOURS_MAX ? TOLERANCE : TOLERANCE_AT_END;
    if (below > 0u && above > 0u)
        return neighbours->count > 2u || (neighbours->offset[0] == -1 && neighbours->offset[1] == 1);
    neighbours->count = 0u;
    return add_side(neighbours, check, i, below > 0u ? -1 : 1, REACH) == (unsigned)REACH;
}

/* How much reading i differs from what its neighbours say, in units of what it may; 0 if they say nothing. */
static float contradiction(const struct check *check, unsigned i) {
    const struct plausibility_input *const input = check->input;
    struct neighbours neighbours;
    if (!find_neighbours(&neighbours, check, i))
        return 0.0f;

    /* The polynomial through the neighbours (Lagrange). */
    float difference[3] = {-input->readings[i][0], -input->readings[i][1], -input->readings[i][2]};
    float motion = 0.0f;
    float length = 0.0f;
    const float share = 1.0f / (float)neighbours.count;
    for (unsigned a = 0; a < neighbours.count; a++) {
        const unsigned j = (unsigned)((int)i + neighbours.offset[a]);
        float weight = 1.0f;
        for (unsigned b = 0; b < neighbours.count; b++)
            if (b != a)
                weight *= (float)neighbours.offset[b] / (float)(neighbours.offset[b] - neighbours.offset[a]);
        vec3_add_scaled(difference, weight, input->readings[j]);
        motion += share * fabsf(check->length[j] - input->size);
        length += share * check->length[j];
    }
    const float allowed = neighbours.tolerance * input->size;
    if (input->has_two_axes)
        return vec3_norm(difference) / allowed; /* a field in which two components are large is no motion */
    motion *= TOLERANCE_MOVING;
    const float of_vector = vec3_norm(difference) / (allowed + motion);
    const float of_length = fabsf(check->length[i] - length) / (TOLERANCE_OF_LENGTH * input->size + motion);
    return larger_of(of_vector, of_length);
}

/* The largest contradiction of a trusted reading in [from, to), and whose it is. */
static float worst_of(const struct check *check, int from, int to, unsigned *index) {
    float worst = 0.0f;
    for (int i = from < 0 ? 0 : from; i < to && i < (int)COUNT; i++) {
        const float value = check->trusted[i] ? contradiction(check, (unsigned)i) : 0.0f;
        if (value > worst) {
            worst = value;
            *index = (unsigned)i;
        }
    }
    return worst;
}

/* Of reading i and those around it, the one without which the others agree best. Without a second neighbour
 * an end says nothing, which is no proof yet that the neighbour is wrong. */
static unsigned culprit_near(struct check *check, unsigned i) {
    static const int8_t STEPS[] = {0, -1, 1, -2, 2};
    unsigned culprit = i;
    float least = INFINITY;
    for (unsigned s = 0; s < sizeof STEPS; s++) {
        const int candidate = (int)i + STEPS[s];
        if (candidate < 0 || candidate >= (int)COUNT || !check->trusted[candidate])
            continue;
        unsigned unused;
        check->trusted[candidate] = false;
        const float left = worst_of(check, (int)i - REACH - 2, (int)i + REACH + 3, &unused);
        check->trusted[candidate] = true;
        if (left + SILENCE < least) {
            least = left;
            culprit = (unsigned)candidate;
        }
    }
    return culprit;
}

/* Whether reading i lies within the tolerance of share * near + (1 - share) * far, and is as long as they
 * are. */
static inline bool is_in_line(const struct check *check, unsigned i, unsigned near, unsigned far, float share,
                              float tolerance) {
    const struct plausibility_input *const input = check->input;
    const float *const a = input->readings[near];
    const float *const b = input->readings[far];
    const float *const v = input->readings[i];
    const float x = v[0] - share * a[0] - (1.0f - share) * b[0];
    const float y = v[1] - share * a[1] - (1.0f - share) * b[1];
    const float z = v[2] - share * a[2] - (1.0f - share) * b[2];
    const float allowed = tolerance * input->size;
    const float longer = check->length[i] - 0.5f * (check->length[near] + check->length[far]);
    return x * x + y * y + z * z < allowed * allowed &&
           (input->has_two_axes || fabsf(longer) < TOLERANCE_OF_LENGTH * input->size);
}

/* A quick answer for nearly every scan: all are trusted, and on straight lines with the two nearest. */
static bool are_all_in_line(const struct check *check) {
    for (unsigned i = 0; i < COUNT; i++)
        if (!check->trusted[i])
            return false;
    for (unsigned i = 1; i + 1u < COUNT; i++)
        if (!is_in_line(check, i, i - 1u, i + 1u, 0.5f, TOLERANCE))
            return false;
    return is_in_line(check, 0u, 1u, 2u, 2.0f, TOLERANCE_AT_END) &&
           is_in_line(check, COUNT - 1u, COUNT - 2u, COUNT - 3u, 2.0f, TOLERANCE_AT_END);
}

void plausibility_check(const struct plausibility_input *input, bool suspect[COUNT]) {
    struct check check = {.input = input};
    for (unsigned i = 0; i < COUNT; i++) {
        check.trusted[i] = input->present[i] && !suspect[i];
        check.length[i] = input->present[i] && !input->has_two_axes ? vec3_norm(input->readings[i]) : 0.0f;
    }

    if (are_all_in_line(&check))
        return; /* and none was a suspect */

    for (unsigned marks = 0; marks < MARKS_MAX; marks++) {
        unsigned worst = 0u;
        if (worst_of(&check, 0, COUNT, &worst) <= 1.0f)
            break;
        check.trusted[culprit_near(&check, worst)] = false;
    }

    for (unsigned i = 0; i < COUNT; i++)
        suspect[i] = input->present[i] && !check.trusted[i] && contradiction(&check, i) > 1.0f;
}
