/* The two DMA controllers (RM0090, 10), as far as the port needs them: DMA1 gives the link's USART a byte
 * whenever it asks, DMA2 gives SPI1 its bytes and takes what comes back. */
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

enum { LINK = 0, SPI = 1 }; /* what a controller is there for */

#define USART2_DR    0x40004404u
#define USART3_DR    0x40004804u
#define LINK_CHANNEL 4u

/* RM0090, table 43. */
#define SPI1_DR       0x4001300Cu
#define SPI_CHANNEL   3u
#define SPI_RX_STREAM 0u
#define SPI_TX_STREAM 3u

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
    return (mcu->dma[LINK].flags[index >> 2] >> flag_shift(index) & FLAG_TRANSFER_COMPLETE) != 0;
}

static void update_interrupt(struct mcu *mcu) {
    const unsigned stream = link_stream(mcu);
    const bool wanted = is_complete(mcu, stream) && (mcu->dma[LINK].stream[stream].cr & CR_TCIE) != 0;
    nvic_set_line(mcu, stream == 6 ? EXCEPTION_DMA1_STREAM6 : EXCEPTION_DMA1_STREAM3, wanted);
}

void dma_reset(struct mcu *mcu) {
    for (unsigned instance = 0; instance < 2; instance++) {
        mcu->dma[instance] = (struct dma){.flags = {0, 0}};
        for (unsigned i = 0; i < 8; i++) {
            mcu->dma[instance].stream[i].fcr = 0x21;
        }
    }
}

static bool has_work(const struct dma_stream *stream) {
    return (stream->cr & CR_EN) != 0 && stream->ndtr > 0;
}

/* Where the next byte is in memory. */
static uint32_t address_of(const struct dma_stream *stream) {
    return stream->m0ar + ((stream->cr & CR_MINC) != 0 ? stream->moved : 0);
}

static uint8_t fetch(struct mcu *mcu, const struct dma_stream *stream) {
    uint8_t byte = 0;
    if (!mcu_peek(mcu, address_of(stream), &byte, 1)) {
        mcu_forbid(mcu, "DMA reads %#x, where no memory is", address_of(stream));
    }
    return byte;
}

/* One byte was moved; after the last one the stream ends. */
static void count(struct mcu *mcu, unsigned instance, unsigned index) {
    struct dma_stream *const stream = &mcu->dma[instance].stream[index];
    stream->moved++;
    stream->ndtr--;
    if (stream->ndtr == 0) {
        stream->cr &= ~CR_EN;
        mcu->dma[instance].flags[index >> 2] |= FLAG_TRANSFER_COMPLETE << flag_shift(index);
        update_interrupt(mcu);
    }
}

void dma_serve_usart(struct mcu *mcu) {
    const unsigned index = link_stream(mcu);
    const struct dma_stream *const stream = &mcu->dma[LINK].stream[index];
    while (has_work(stream) && usart_wants_dma(mcu)) {
        const uint8_t byte = fetch(mcu, stream);
        usart_put(mcu, byte);
        count(mcu, LINK, index);
    }
}

uint32_t dma_left(const struct mcu *mcu) {
    const struct dma_stream *const stream = &mcu->dma[LINK].stream[link_stream(mcu)];
    return (stream->cr & CR_EN) != 0 ? stream->ndtr : 0;
}

bool dma_take_spi(struct mcu *mcu, uint8_t *byte) {
    const struct dma_stream *const stream = &mcu->dma[SPI].stream[SPI_TX_STREAM];
    if (!has_work(stream)) {
        return false;
    }
    *byte = fetch(mcu, stream);
    count(mcu, SPI, SPI_TX_STREAM);
    return true;
}

bool dma_give_spi(struct mcu *mcu, uint8_t byte) {
    const struct dma_stream *const stream = &mcu->dma[SPI].stream[SPI_RX_STREAM];
    if (!has_work(stream)) {
        return false;
    }
    const uint32_t offset = address_of(stream) - RAM_START;
    if (offset < RAM_BYTES) {
        mcu->ram[offset] = byte;
    } else {
        mcu_forbid(mcu, "DMA writes %#x, where no RAM is", address_of(stream));
    }
    count(mcu, SPI, SPI_RX_STREAM);
    return true;
}

uint32_t dma_left_of_spi(const struct mcu *mcu) {
    const struct dma_stream *const stream = &mcu->dma[SPI].stream[SPI_TX_STREAM];
    return (stream->cr & CR_EN) != 0 ? stream->ndtr : 0;
}

uint32_t dma_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    if (offset == LISR || offset == HISR) {
        if (instance == SPI) {
            spi_finish(mcu);
        }
        return mcu->dma[instance].flags[offset / 4];
    }
    if (offset < STREAMS || offset >= STREAMS + 8 * STREAM_BYTES) {
        return 0;
    }
    const struct dma_stream *const stream = &mcu->dma[instance].stream[(offset - STREAMS) / STREAM_BYTES];
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

static bool is_for_link(const struct mcu *mcu, unsigned index) {
    const struct dma_stream *const stream = &mcu->dma[LINK].stream[index];
    return index == link_stream(mcu) && stream->cr >> 25 == LINK_CHANNEL &&
           stream->par == (mcu->wiring.link_usart == 2 ? USART2_DR : USART3_DR) &&
           (stream->cr & (CR_DIRECTION | CR_CIRC | CR_SIZES)) == CR_TO_PERIPHERAL;
}

static bool is_for_spi(const struct mcu *mcu, unsigned index) {
    const struct dma_stream *const stream = &mcu->dma[SPI].stream[index];
    return (index == SPI_RX_STREAM || index == SPI_TX_STREAM) && stream->cr >> 25 == SPI_CHANNEL &&
           stream->par == SPI1_DR &&
           (stream->cr & (CR_DIRECTION | CR_CIRC | CR_SIZES | CR_TCIE)) ==
               (index == SPI_TX_STREAM ? CR_TO_PERIPHERAL : 0u);
}

static void start(struct mcu *mcu, unsigned instance, unsigned index) {
    struct dma_stream *const stream = &mcu->dma[instance].stream[index];
    if (!(instance == LINK ? is_for_link(mcu, index) : is_for_spi(mcu, index))) {
        mcu_forbid(mcu,
                   "DMA%u stream %u with CR = %#x and %#x: only bytes to the link, and of SPI1, are modelled",
                   instance + 1, index, stream->cr, stream->par);
        return;
    }
    const uint32_t left_over = mcu->dma[instance].flags[index >> 2] >> flag_shift(index) & FLAGS_OF_A_STREAM;
    if (left_over != 0) {
        mcu_forbid(mcu, "DMA%u stream %u started with flags left over", instance + 1, index);
        return;
    }
    stream->moved = 0;
    if (instance == LINK) {
        dma_serve_usart(mcu);
    } else {
        spi_serve_dma(mcu, mcu->now);
    }
}

void dma_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    if (offset == LIFCR || offset == HIFCR) {
        const unsigned index = link_stream(mcu);
        const bool was_complete = is_complete(mcu, index);
        mcu->dma[instance].flags[(offset - LIFCR) / 4] &= ~value;
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
    struct dma_stream *const stream = &mcu->dma[instance].stream[index];
    const uint32_t which = (offset - STREAMS) % STREAM_BYTES;
    if ((stream->cr & CR_EN) != 0 && which != CR) {
        mcu_forbid(mcu, "DMA%u stream %u changed while it runs", instance + 1, index);
        return;
    }
    switch (which) {
    case CR: {
        const bool starts = (value & CR_EN) != 0 && (stream->cr & CR_EN) == 0;
        stream->cr = value;
        if (starts) {
            start(mcu, instance, index);
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
