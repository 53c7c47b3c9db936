/* DMA1 (RM0090, 10), as far as a USART that sends needs it: one byte whenever the USART asks. */
#include "machine.h"

enum { LISR = 0x00, HISR = 0x04, LIFCR = 0x08, HIFCR = 0x0C, STREAMS = 0x10, STREAM_BYTES = 0x18 };
enum { CR = 0x00, NDTR = 0x04, PAR = 0x08, M0AR = 0x0C, M1AR = 0x10, FCR = 0x14 };

#define CR_EN            (1u << 0)
#define CR_TCIE          (1u << 4)
#define CR_DIRECTION     (3u << 6)
#define CR_TO_PERIPHERAL (1u << 6)
#define CR_CIRC          (1u << 8)
#define CR_MINC          (1u << 10)
#define CR_SIZES         (15u << 11)

#define FLAGS_OF_A_STREAM      0x3Du
#define FLAG_TRANSFER_COMPLETE (1u << 5)

#define USART2_DR 0x40004404u
#define USART3_DR 0x40004804u
#define CHANNEL   4u

/* Where the flags of a stream are in LISR or HISR. */
static unsigned flag_shift(unsigned stream) {
    static const unsigned SHIFTS[4] = {0, 6, 16, 22};
    return SHIFTS[stream & 3u];
}

/* RM0090, table 42. */
static unsigned link_stream(const struct mcu *mcu) {
    return mcu->wiring.link_usart == 2 ? 6 : 3;
}

static bool is_complete(const struct mcu *mcu, unsigned index) {
    return (mcu->dma_flags[index >> 2] >> flag_shift(index) & FLAG_TRANSFER_COMPLETE) != 0;
}

static void update_interrupt(struct mcu *mcu) {
    const unsigned stream = link_stream(mcu);
    const bool wanted = is_complete(mcu, stream) && (mcu->dma[stream].cr & CR_TCIE) != 0;
    nvic_set_line(mcu, stream == 6 ? EXCEPTION_DMA1_STREAM6 : EXCEPTION_DMA1_STREAM3, wanted);
}

void dma_reset(struct mcu *mcu) {
    for (unsigned i = 0; i < 8; i++) {
        mcu->dma[i] = (struct dma_stream){.fcr = 0x21};
    }
    mcu->dma_flags[0] = mcu->dma_flags[1] = 0;
}

void dma_serve_usart(struct mcu *mcu) {
    const unsigned index = link_stream(mcu);
    struct dma_stream *const stream = &mcu->dma[index];
    while ((stream->cr & CR_EN) != 0 && stream->ndtr > 0 && usart_wants_dma(mcu)) {
        uint8_t byte = 0;
        const uint32_t step = (stream->cr & CR_MINC) != 0 ? 1 : 0;
        if (!mcu_peek(mcu, stream->m0ar + step * stream->moved, &byte, 1)) {
            mcu_forbid(mcu, "DMA reads %#x, where no memory is", stream->m0ar + step * stream->moved);
        }
        stream->moved++;
        stream->ndtr--;
        usart_put(mcu, byte);
    }
    if ((stream->cr & CR_EN) != 0 && stream->ndtr == 0) {
        stream->cr &= ~CR_EN;
        mcu->dma_flags[index >> 2] |= FLAG_TRANSFER_COMPLETE << flag_shift(index);
        update_interrupt(mcu);
    }
}

uint32_t dma_left(const struct mcu *mcu) {
    const struct dma_stream *const stream = &mcu->dma[link_stream(mcu)];
    return (stream->cr & CR_EN) != 0 ? stream->ndtr : 0;
}

uint32_t dma_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    if (offset == LISR || offset == HISR) {
        return mcu->dma_flags[offset / 4];
    }
    if (offset < STREAMS || offset >= STREAMS + 8 * STREAM_BYTES) {
        return 0;
    }
    const struct dma_stream *const stream = &mcu->dma[(offset - STREAMS) / STREAM_BYTES];
    switch ((offset - STREAMS) % STREAM_BYTES) {
    case CR:
        return stream->cr;
    case NDTR:
        return stream->ndtr;
    case PAR:
        return stream->par;
    case M0AR:
        return stream->m0ar;
    case FCR:
        return stream->fcr;
    default:
        return 0;
    }
}

static void start(struct mcu *mcu, unsigned index) {
    struct dma_stream *const stream = &mcu->dma[index];
    const uint32_t data_register = mcu->wiring.link_usart == 2 ? USART2_DR : USART3_DR;
    if (index != link_stream(mcu) || stream->cr >> 25 != CHANNEL || stream->par != data_register ||
        (stream->cr & (CR_DIRECTION | CR_CIRC | CR_SIZES)) != CR_TO_PERIPHERAL) {
        mcu_forbid(mcu, "DMA stream %u with CR = %#x to %#x: only bytes to the link are modelled", index,
                   stream->cr, stream->par);
        return;
    }
    const uint32_t left_over = mcu->dma_flags[index >> 2] >> flag_shift(index) & FLAGS_OF_A_STREAM;
    if (left_over != 0) {
        mcu_forbid(mcu, "DMA stream %u started with flags left over", index);
        return;
    }
    stream->moved = 0;
    dma_serve_usart(mcu);
}

void dma_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    if (offset == LIFCR || offset == HIFCR) {
        const unsigned index = link_stream(mcu);
        const bool was_complete = is_complete(mcu, index);
        mcu->dma_flags[(offset - LIFCR) / 4] &= ~value;
        if (was_complete && !is_complete(mcu, index)) {
            mcu_log(mcu, LOGGED_SENT, 0, 0, 0);
        }
        update_interrupt(mcu);
        return;
    }
    if (offset < STREAMS || offset >= STREAMS + 8 * STREAM_BYTES) {
        mcu_forbid(mcu, "write to DMA register %#x", offset);
        return;
    }
    const unsigned index = (offset - STREAMS) / STREAM_BYTES;
    struct dma_stream *const stream = &mcu->dma[index];
    const uint32_t which = (offset - STREAMS) % STREAM_BYTES;
    if ((stream->cr & CR_EN) != 0 && which != CR) {
        mcu_forbid(mcu, "DMA stream %u changed while it runs", index);
        return;
    }
    switch (which) {
    case CR: {
        const bool starts = (value & CR_EN) != 0 && (stream->cr & CR_EN) == 0;
        stream->cr = value;
        if (starts) {
            start(mcu, index);
        }
        break;
    }
    case NDTR:
        stream->ndtr = value & 0xFFFFu;
        break;
    case PAR:
        stream->par = value;
        break;
    case M0AR:
        stream->m0ar = value;
        break;
    case FCR:
        stream->fcr = value;
        break;
    default:
        mcu_forbid(mcu, "DMA's second memory address is not modelled");
        break;
    }
}
