/* SPI1 as a master, polled or served by DMA (RM0090, 28): a shift register with one byte of buffer each way.
 */
#include "machine.h"

enum { CR1 = 0x00, CR2 = 0x04, SR = 0x08, DR = 0x0C };

#define CR1_MODE     0xFFFFu
#define CR1_MODE_3   3u
#define CR1_MSTR     (1u << 2)
#define CR1_SPE      (1u << 6)
#define CR1_LSBFIRST (1u << 7)
#define CR1_SSI      (1u << 8)
#define CR1_SSM      (1u << 9)
#define CR1_DFF      (1u << 11)
#define CR2_RXDMAEN  (1u << 0)
#define CR2_TXDMAEN  (1u << 1)
#define SR_RXNE      (1u << 0)
#define SR_TXE       (1u << 1)
#define SR_OVR       (1u << 6)
#define SR_BSY       (1u << 7)
#define SPI_HZ_MAX   10000000u /* of the sensor parts */

void spi_reset(struct mcu *mcu) {
    mcu->spi = (struct spi){0};
}

static uint64_t byte_ticks(const struct mcu *mcu) {
    return 8ull * TICKS_HZ * (2u << (mcu->spi.cr1 >> 3 & 7u)) / rcc_pclk_hz(mcu, 2);
}

static void start(struct mcu *mcu, uint64_t at, uint8_t byte) {
    struct spi *const spi = &mcu->spi;
    const uint32_t wanted = CR1_MSTR | CR1_SPE | CR1_SSI | CR1_SSM | CR1_MODE_3;
    if ((spi->cr1 & (wanted | CR1_LSBFIRST | CR1_DFF)) != wanted) {
        mcu_forbid(mcu, "SPI transfer with CR1 = %#x: not an enabled master in mode 3, 8 bits", spi->cr1);
    }
    spi->shifting = true;
    spi->shift_end = at + byte_ticks(mcu);
    if (TICKS_HZ * 8u / byte_ticks(mcu) > SPI_HZ_MAX) {
        mcu_forbid(mcu, "SPI clock above 10 MHz");
    }
    spi->shift_in = string_transfer(mcu, spi->shift_end, byte);
}

void spi_serve_dma(struct mcu *mcu, uint64_t at) {
    struct spi *const spi = &mcu->spi;
    uint8_t byte;
    if (spi->rx_full && (spi->cr2 & CR2_RXDMAEN) != 0 && dma_give_spi(mcu, spi->rx)) {
        spi->rx_full = false;
    }
    if (!spi->shifting && (spi->cr2 & CR2_TXDMAEN) != 0 && (spi->cr1 & CR1_SPE) != 0 &&
        dma_take_spi(mcu, &byte)) {
        start(mcu, at, byte);
    }
}

static void catch_up(struct mcu *mcu) {
    struct spi *const spi = &mcu->spi;
    while (spi->shifting && spi->shift_end <= mcu->now) {
        spi->shifting = false;
        if (spi->rx_full) {
            spi->overrun = true;
        } else {
            spi->rx = spi->shift_in;
            spi->rx_full = true;
        }
        if (spi->tx_full) {
            spi->tx_full = false;
            start(mcu, spi->shift_end, spi->tx);
        }
        spi_serve_dma(mcu, spi->shift_end);
    }
}

/* Something else may want the core before the last byte is there. */
void spi_finish(struct mcu *mcu) {
    catch_up(mcu);
    if (mcu->spi.shifting) {
        const uint64_t end = mcu->spi.shift_end + dma_left_of_spi(mcu) * byte_ticks(mcu);
        time_warp(mcu, end < mcu->stop_at ? end : mcu->stop_at);
        catch_up(mcu);
    }
}

uint32_t spi_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    struct spi *const spi = &mcu->spi;
    catch_up(mcu);
    switch (offset) {
    case CR1:
        return spi->cr1;
    case CR2:
        return spi->cr2;
    case SR:
        if (spi->shifting) {
            time_warp(mcu, spi->shift_end);
            catch_up(mcu);
        }
        return (spi->rx_full ? SR_RXNE : 0) | (spi->tx_full ? 0 : SR_TXE) | (spi->overrun ? SR_OVR : 0) |
               (spi->shifting ? SR_BSY : 0);
    case DR:
        spi->rx_full = false;
        return spi->rx;
    default:
        mcu_forbid(mcu, "read of SPI register %#x, which is not modelled", offset);
        return 0;
    }
}

void spi_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    struct spi *const spi = &mcu->spi;
    catch_up(mcu);
    switch (offset) {
    case CR1:
        spi->cr1 = value & CR1_MODE;
        break;
    case CR2:
        spi->cr2 = value;
        if ((value & ~(CR2_RXDMAEN | CR2_TXDMAEN)) != 0) {
            mcu_forbid(mcu, "SPI interrupts are not modelled");
        }
        break;
    case DR:
        if (!spi->shifting) {
            start(mcu, mcu->now, (uint8_t)value);
        } else {
            if (spi->tx_full) {
                mcu_forbid(mcu, "SPI data register written while it is full");
            }
            spi->tx = (uint8_t)value;
            spi->tx_full = true;
        }
        break;
    default:
        mcu_forbid(mcu, "write to SPI register %#x, which is not modelled", offset);
        break;
    }
}
