/* Who this board is, and why it last started. */
#include <string.h>

#include BOARD_HEADER
#include "port.h"

/* The pin's flag is set by every reset, the brown-out's also at power-on: the order decides. */
static enum wire_reset_cause reset_cause(void) {
    const uint32_t flags = RCC->CSR;
    RCC->CSR = flags | RCC_CSR_RMVF;
    if ((flags & (RCC_CSR_WDGRSTF | RCC_CSR_WWDGRSTF)) != 0) {
        return WIRE_RESET_CAUSE_WATCHDOG;
    }
    if ((flags & RCC_CSR_SFTRSTF) != 0) {
        return WIRE_RESET_CAUSE_SOFTWARE;
    }
    if ((flags & RCC_CSR_PORRSTF) != 0) {
        return WIRE_RESET_CAUSE_POWER_ON;
    }
    if ((flags & RCC_CSR_BORRSTF) != 0) {
        return WIRE_RESET_CAUSE_BROWN_OUT;
    }
    return (flags & RCC_CSR_PADRSTF) != 0 ? WIRE_RESET_CAUSE_PIN : WIRE_RESET_CAUSE_UNKNOWN;
}

void identity_read(const struct clocks *clocks, struct board_identity *identity) {
    *identity = (struct board_identity){
        .board = BOARD_ID, .reset_cause = reset_cause(), .clock_source = clocks->source};
    /* Where no RCC answers there is no system memory either, and reading it would be a fault. */
    if (clocks->answered) {
        memcpy(identity->unique_id, UNIQUE_ID, sizeof identity->unique_id);
    }
    struct fault_record record;
    if (faults_take_record(&record)) {
        identity->reset_cause = WIRE_RESET_CAUSE_HARD_FAULT;
        identity->fault_pc = record.pc;
        identity->fault_lr = record.lr;
        identity->fault_cfsr = record.cfsr;
    }
}

void board_identify(struct board *board, struct board_identity *identity) {
    *identity = board->identity;
}
