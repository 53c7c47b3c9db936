/* The sensor string: SPI1 in mode 3, and the two wires of the select chain. */
#include <string.h>

#include BOARD_HEADER
#include "port.h"

#define SPI_HZ_MAX   6000000u /* the parts allow 8 to 10 MHz; the rest is for a metre of ribbon */
#define SPI_FUNCTION 5u
#define POLLS_MAX    5000u /* a poll takes ten cycles; the longest transfer, at a sixth of 16 MHz, 400 */

/* RM0090 table 43: channel 3 of DMA2 carries SPI1_RX in stream 0 and SPI1_TX in stream 3. */
#define SPI_DMA_CHANNEL 3u
#define RX_STREAM       DMA2->S[0]
#define TX_STREAM       DMA2->S[3]
#define CLEAR_RX                                                                                             \
    (DMA_LIFCR_CFEIF0 | DMA_LIFCR_CDMEIF0 | DMA_LIFCR_CTEIF0 | DMA_LIFCR_CHTIF0 | DMA_LIFCR_CTCIF0)
#define CLEAR_TX                                                                                             \
    (DMA_LIFCR_CFEIF3 | DMA_LIFCR_CDMEIF3 | DMA_LIFCR_CTEIF3 | DMA_LIFCR_CHTIF3 | DMA_LIFCR_CTCIF3)

#define SELECT_PHASE_LOOPS                                                                                   \
    4u /* of 3 cycles: 71 ns. 74HC logic needs 30 ns at 3.3 V, the rest is for the wires */

void bus_start(struct board *board) {
    RCC->AHB1ENR |= RCC_AHB1ENR_DMA2EN;
    RCC->APB2ENR |= RCC_APB2ENR_SPI1EN;
    (void)RCC->APB2ENR;

    gpio_write(BOARD_SEL_CLK, false);
    gpio_write(BOARD_SEL_DATA, true);
    board->sel_data = true;
    gpio_set_up_output(BOARD_SEL_CLK);
    gpio_set_up_output(BOARD_SEL_DATA);

    /* SPI before its pins: SCK then idles high from the first moment on. A string that is not plugged in
     * reads as ones. */
    uint32_t divider_code = 0;
    while (divider_code < 7 && board->clocks.pclk2_hz >> (divider_code + 1) > SPI_HZ_MAX) {
        divider_code++;
    }
    SPI1->CR1 =
        SPI_CR1_CPHA | SPI_CR1_CPOL | SPI_CR1_MSTR | SPI_CR1_BR(divider_code) | SPI_CR1_SSI | SPI_CR1_SSM;
    SPI1->CR2 = SPI_CR2_RXDMAEN | SPI_CR2_TXDMAEN;
    SPI1->CR1 |= SPI_CR1_SPE;
    RX_STREAM.PAR = TX_STREAM.PAR = (uint32_t)&SPI1->DR;
    gpio_pull_up(BOARD_SPI_MISO);
    gpio_set_up_alternate(BOARD_SPI_SCK, SPI_FUNCTION);
    gpio_set_up_alternate(BOARD_SPI_MISO, SPI_FUNCTION);
    gpio_set_up_alternate(BOARD_SPI_MOSI, SPI_FUNCTION);
}

/* A byte left behind would be taken for the first of the next answer, and every one after it for the next. */
static void give_up(uint8_t *rx, size_t n) {
    TX_STREAM.CR = 0;
    RX_STREAM.CR = 0;
    (void)poll_until(&TX_STREAM.CR, DMA_SxCR_EN, 0, POLLS_MAX);
    (void)poll_until(&RX_STREAM.CR, DMA_SxCR_EN, 0, POLLS_MAX);
    (void)poll_until(&SPI1->SR, SPI_SR_BSY, 0, POLLS_MAX);
    (void)SPI1->DR;
    (void)SPI1->SR; /* after DR: this ends an overrun */
    memset(rx, 0xFF, n);
}

void board_spi_transfer(struct board *board, const uint8_t *tx, uint8_t *rx, size_t n) {
    (void)board;
    if (n == 0)
        return;
    DMA2->LIFCR = CLEAR_RX | CLEAR_TX;
    RX_STREAM.M0AR = (uint32_t)rx;
    RX_STREAM.NDTR = n;
    RX_STREAM.CR = DMA_SxCR_CHSEL(SPI_DMA_CHANNEL) | DMA_SxCR_MINC | DMA_SxCR_EN;
    TX_STREAM.M0AR = (uint32_t)tx;
    TX_STREAM.NDTR = n;
    barrier(); /* the bytes are in memory before the controller reads them */
    TX_STREAM.CR = DMA_SxCR_CHSEL(SPI_DMA_CHANNEL) | DMA_SxCR_MINC | DMA_SxCR_DIR_TO_PERIPHERAL | DMA_SxCR_EN;
    if (!poll_until(&DMA2->LISR, DMA_LISR_TCIF0, DMA_LISR_TCIF0, POLLS_MAX)) {
        give_up(rx, n);
    }
    /* The last bit's second half is still on the wire when it is read; nothing may be deselected before. */
    (void)poll_until(&SPI1->SR, SPI_SR_BSY, 0, POLLS_MAX);
    barrier();
}

static inline void hold(void) {
    uint32_t loops = SELECT_PHASE_LOOPS;
    __asm volatile("1: subs %0, #1\n\tbne 1b" : "+r"(loops)::"cc");
}

void board_select_clock(struct board *board, bool data) {
    if (data != board->sel_data) {
        gpio_write(BOARD_SEL_DATA, data);
        board->sel_data = data;
        hold();
    }
    gpio_write(BOARD_SEL_CLK, true);
    hold();
    gpio_write(BOARD_SEL_CLK, false); /* the way to the next pulse is longer than it must be low */
}
