/* The USART that the link is on (RM0090, 30): bytes take ten bits of time, each way. */
#include "machine.h"

enum { SR = 0x00, DR = 0x04, BRR = 0x08, CR1 = 0x0C, CR2 = 0x10, CR3 = 0x14 };

#define SR_ORE     (1u << 3)
#define SR_RXNE    (1u << 5)
#define SR_TC      (1u << 6)
#define SR_TXE     (1u << 7)
#define CR1_RE     (1u << 2)
#define CR1_TE     (1u << 3)
#define CR1_RXNEIE (1u << 5)
#define CR1_TCIE   (1u << 6)
#define CR1_TXEIE  (1u << 7)
#define CR1_UE     (1u << 13)
#define CR3_DMAT   (1u << 7)

#define LINK_FUNCTION 7u

void usart_reset(struct mcu *mcu) {
    mcu->usart = (struct usart){.tx_complete = true};
}

static void update_interrupt(struct mcu *mcu) {
    const struct usart *const usart = &mcu->usart;
    const bool wanted = ((usart->cr1 & CR1_RXNEIE) != 0 && (usart->rx_full || usart->overrun)) ||
                        ((usart->cr1 & CR1_TXEIE) != 0 && !usart->tx_full) ||
                        ((usart->cr1 & CR1_TCIE) != 0 && usart->tx_complete);
    nvic_set_line(mcu, mcu->wiring.link_usart == 2 ? EXCEPTION_USART2 : EXCEPTION_USART3, wanted);
}

static uint64_t byte_ticks(const struct mcu *mcu) {
    return 10ull * TICKS_HZ * mcu->usart.brr / rcc_pclk_hz(mcu, 1);
}

/* A receiver samples in the middle of the last bit, 9.5 bits after the start: 4 % off is too much. */
static bool rates_agree(const struct mcu *mcu) {
    if (mcu->usart.brr == 0) {
        return false;
    }
    const double ratio = (double)rcc_pclk_hz(mcu, 1) / mcu->usart.brr / mcu->options.link_baud;
    return ratio > 0.96 && ratio < 1.04;
}

static void start_sending(struct mcu *mcu, uint64_t at, uint8_t byte) {
    struct usart *const usart = &mcu->usart;
    usart->shift = byte;
    usart->shifting = true;
    time_schedule(mcu, EVENT_LINK_SENT, at + byte_ticks(mcu));
}

bool usart_wants_dma(const struct mcu *mcu) {
    return (mcu->usart.cr3 & CR3_DMAT) != 0 && (mcu->usart.cr1 & CR1_UE) != 0 && !mcu->usart.tx_full;
}

void usart_put(struct mcu *mcu, uint8_t byte) {
    struct usart *const usart = &mcu->usart;
    if ((usart->cr1 & (CR1_UE | CR1_TE)) != (CR1_UE | CR1_TE) || usart->brr < 16) {
        mcu_forbid(mcu, "byte to a USART that is off");
        return;
    }
    if (!usart->shifting) {
        start_sending(mcu, mcu->now, byte);
    } else if (!usart->tx_full) {
        usart->tx = byte;
        usart->tx_full = true;
    } else {
        mcu_forbid(mcu, "USART data register written while it is full");
    }
}

/* When the last byte that is known of will have left. */
uint64_t usart_all_sent(const struct mcu *mcu) {
    const uint64_t at = mcu->events[EVENT_LINK_SENT];
    return at == NEVER ? NEVER : at + byte_ticks(mcu) * (dma_left(mcu) + (mcu->usart.tx_full ? 1u : 0u));
}

/* The last bit of a byte has left. */
void usart_sent(struct mcu *mcu) {
    struct usart *const usart = &mcu->usart;
    const uint64_t at = mcu->events[EVENT_LINK_SENT];
    mcu->events[EVENT_LINK_SENT] = NEVER;
    if (gpio_is_alternate(mcu, mcu->wiring.link_tx, LINK_FUNCTION)) {
        const uint8_t heard = rates_agree(mcu) ? usart->shift : (uint8_t)(usart->shift ^ 0xA5u);
        mcu->counters.link_bytes_unread += queue_put(&mcu->from_firmware, heard) ? 0u : 1u;
    }
    mcu->counters.link_bytes_sent++;
    usart->shifting = false;
    if (usart->tx_full) {
        usart->tx_full = false;
        start_sending(mcu, at, usart->tx);
    } else {
        usart->tx_complete = true;
    }
    dma_serve_usart(mcu);
    update_interrupt(mcu);
}

/* Something waits in the queue toward the firmware: its first byte is on the way. */
void usart_expect(struct mcu *mcu) {
    if (mcu->to_firmware.count > 0 && mcu->events[EVENT_LINK_RECEIVED] == NEVER) {
        time_schedule(mcu, EVENT_LINK_RECEIVED, mcu->now + 10ull * TICKS_HZ / mcu->options.link_baud);
    }
}

void usart_received(struct mcu *mcu) {
    struct usart *const usart = &mcu->usart;
    uint8_t byte = 0;
    (void)queue_take(&mcu->to_firmware, &byte);
    mcu->events[EVENT_LINK_RECEIVED] = NEVER;
    usart_expect(mcu);

    const bool listens = (usart->cr1 & (CR1_UE | CR1_RE)) == (CR1_UE | CR1_RE) &&
                         gpio_is_alternate(mcu, mcu->wiring.link_rx, LINK_FUNCTION);
    if (!listens || usart->rx_full) {
        usart->overrun = listens;
        mcu->counters.link_bytes_lost++;
    } else {
        usart->rx = rates_agree(mcu) ? byte : (uint8_t)(byte ^ 0x5Au);
        usart->rx_full = true;
    }
    update_interrupt(mcu);
}

static bool is_link(const struct mcu *mcu, unsigned instance) {
    return instance == mcu->wiring.link_usart;
}

uint32_t usart_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    struct usart *const usart = &mcu->usart;
    if (!is_link(mcu, instance)) {
        mcu_forbid(mcu, "USART%u is not wired to the link", instance);
        return 0;
    }
    switch (offset) {
    case SR:
        if (usart->shifting && !usart->rx_full) {
            time_warp(mcu, mcu->events[EVENT_LINK_SENT]);
            while (mcu->events[EVENT_LINK_SENT] <= mcu->now) {
                usart_sent(mcu);
            }
        }
        usart->status_read = true;
        return (usart->overrun ? SR_ORE : 0) | (usart->rx_full ? SR_RXNE : 0) |
               (usart->tx_complete ? SR_TC : 0) | (usart->tx_full ? 0 : SR_TXE);
    case DR:
        if (usart->rx_full) {
            mcu_log(mcu, LOGGED_RECEIVED, 0, 0, usart->rx);
        }
        usart->rx_full = false;
        usart->overrun = false;
        update_interrupt(mcu);
        return usart->rx;
    case BRR:
        return usart->brr;
    case CR1:
        return usart->cr1;
    case CR2:
        return usart->cr2;
    case CR3:
        return usart->cr3;
    default:
        mcu_forbid(mcu, "read of USART register %#x, which is not modelled", offset);
        return 0;
    }
}

void usart_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    struct usart *const usart = &mcu->usart;
    if (!is_link(mcu, instance)) {
        mcu_forbid(mcu, "USART%u is not wired to the link", instance);
        return;
    }
    switch (offset) {
    case SR:
        usart->tx_complete = usart->tx_complete && (value & SR_TC) != 0;
        break;
    case DR:
        usart->tx_complete = usart->tx_complete && !usart->status_read;
        usart->status_read = false;
        usart_put(mcu, (uint8_t)value);
        break;
    case BRR:
        usart->brr = value & 0xFFFFu;
        break;
    case CR1:
        usart->cr1 = value;
        break;
    case CR2:
        usart->cr2 = value;
        break;
    case CR3:
        usart->cr3 = value;
        break;
    default:
        mcu_forbid(mcu, "write to USART register %#x, which is not modelled", offset);
        break;
    }
    dma_serve_usart(mcu);
    update_interrupt(mcu);
}
