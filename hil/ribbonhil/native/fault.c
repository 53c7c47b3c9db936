/* The list of faults of one bus. */
#include "fault.h"

#include <stddef.h>

int fault_add(struct fault_list *list, const struct fault *fault) {
    if (list->count >= FAULT_CAPACITY || fault->kind >= FAULT_KIND_COUNT ||
        fault->start_ns >= fault->end_ns) {
        return -1;
    }
    list->faults[list->count++] = *fault;
    return 0;
}

const struct fault *fault_active(const struct fault_list *list, uint32_t slot, enum fault_kind kind,
                                 uint64_t t_ns) {
    for (uint32_t i = 0; i < list->count; i++) {
        const struct fault *fault = &list->faults[i];
        if (fault->kind == kind && fault->slot == slot && fault->start_ns <= t_ns && t_ns < fault->end_ns) {
            return fault;
        }
    }
    return NULL;
}

uint64_t fault_last_power_up_ns(const struct fault_list *list, uint32_t slot, uint64_t after_ns,
                                uint64_t until_ns) {
    uint64_t last_ns = 0;
    for (uint32_t i = 0; i < list->count; i++) {
        const struct fault *fault = &list->faults[i];
        if (fault->slot != slot || (fault->kind != FAULT_ABSENT && fault->kind != FAULT_BROWN_OUT)) {
            continue;
        }
        uint64_t t_ns = fault->kind == FAULT_ABSENT ? fault->end_ns : fault->start_ns;
        if (t_ns > after_ns && t_ns <= until_ns && t_ns > last_ns) {
            last_ns = t_ns;
        }
    }
    return last_ns;
}
