/* The link to the host: a USART that sends by DMA and receives byte by byte into a ring. */
#include BOARD_HEADER
#include "port.h"

#ifndef LINK_BAUD
#define LINK_BAUD 921600u
#endif

#define LINK_FUNCTION 7u
#define POLLS_MAX     100000u /* more than ten bits at 1200 baud */

/* RM0090 table 42: channel 4 of DMA1 carries USART2_TX in stream 6 and USART3_TX in stream 3. */
#define LINK_DMA_CHANNEL 4u
#if BOARD_LINK_USART == 2
#define LINK_USART        USART2
#define LINK_CLOCK_ENABLE RCC_APB1ENR_USART2EN
#define LINK_IRQ          IRQ_USART2
#define LINK_DMA_STREAM   DMA1->S[6]
#define LINK_DMA_IRQ      IRQ_DMA1_STREAM6
#define LINK_DMA_CLEAR    DMA1->HIFCR
#define LINK_DMA_CLEAR_ALL                                                                                   \
    (DMA_HIFCR_CFEIF6 | DMA_HIFCR_CDMEIF6 | DMA_HIFCR_CTEIF6 | DMA_HIFCR_CHTIF6 | DMA_HIFCR_CTCIF6)
#define link_usart_handler usart2_handler
#define link_dma_handler   dma1_stream6_handler
#elif BOARD_LINK_USART == 3
#define LINK_USART        USART3
#define LINK_CLOCK_ENABLE RCC_APB1ENR_USART3EN
#define LINK_IRQ          IRQ_USART3
#define LINK_DMA_STREAM   DMA1->S[3]
#define LINK_DMA_IRQ      IRQ_DMA1_STREAM3
#define LINK_DMA_CLEAR    DMA1->LIFCR
#define LINK_DMA_CLEAR_ALL                                                                                   \
    (DMA_LIFCR_CFEIF3 | DMA_LIFCR_CDMEIF3 | DMA_LIFCR_CTEIF3 | DMA_LIFCR_CHTIF3 | DMA_LIFCR_CTCIF3)
#define link_usart_handler usart3_handler
#define link_dma_handler   dma1_stream3_handler
#endif

static void enable_interrupt(enum interrupt irq) {
    NVIC->ISER[irq >> 5] = 1u << (irq & 31);
}

/* A machine without DMA (QEMU's netduinoplus2) reads registers that were written as 0. */
static bool dma_answers(void) {
    LINK_DMA_STREAM.NDTR = 1;
    return LINK_DMA_STREAM.NDTR == 1;
}

void link_start(struct board *board) {
    RCC->AHB1ENR |= RCC_AHB1ENR_DMA1EN;
    RCC->APB1ENR |= LINK_CLOCK_ENABLE;
    (void)RCC->APB1ENR;

    LINK_USART->BRR = (board->clocks.pclk1_hz + LINK_BAUD / 2) / LINK_BAUD;
    LINK_USART->CR3 = USART_CR3_DMAT;
    LINK_USART->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE;
    gpio_pull_up(BOARD_LINK_RX); /* nothing plugged in is silence, not a stream of breaks */
    gpio_set_up_alternate(BOARD_LINK_TX, LINK_FUNCTION);
    gpio_set_up_alternate(BOARD_LINK_RX, LINK_FUNCTION);

    board->dma_answers = dma_answers();
    enable_interrupt(LINK_IRQ);
    enable_interrupt(LINK_DMA_IRQ);
}

/* Reading SR and then DR also clears an overrun. A full ring drops the byte: its frame fails the CRC and is
 * counted there. */
void link_usart_handler(void);
void link_usart_handler(void) {
    struct board *const board = &the_board;
    const uint32_t status = LINK_USART->SR;
    const uint8_t byte = (uint8_t)LINK_USART->DR;
    const uint32_t head = board->rx_head;
    if ((status & USART_SR_RXNE) != 0 && head - board->rx_tail < LINK_RX_BYTES) {
        board->rx[head % LINK_RX_BYTES] = byte;
        board->rx_head = head + 1;
    }
}

/* The end of a send, by its last byte or by a bus error: either way the buffer is free. */
void link_dma_handler(void);
void link_dma_handler(void) {
    LINK_DMA_CLEAR = LINK_DMA_CLEAR_ALL;
    the_board.sending = false;
    the_board.send_ended = true;
}

size_t board_link_read(struct board *board, uint8_t *bytes, size_t capacity) {
    const uint32_t head = board->rx_head;
    uint32_t tail = board->rx_tail;
    size_t n = 0;
    while (n < capacity && tail != head) {
        bytes[n++] = board->rx[tail++ % LINK_RX_BYTES];
    }
    board->rx_tail = tail;
    return n;
}

static void send_without_dma(const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++) {
        (void)poll_until(&LINK_USART->SR, USART_SR_TXE, USART_SR_TXE, POLLS_MAX);
        LINK_USART->DR = bytes[i];
    }
}

bool board_link_send(struct board *board, const uint8_t *bytes, size_t n) {
    if (board->sending) {
        return false;
    }
    if (n == 0) {
        return true;
    }
    if (!board->dma_answers) {
        send_without_dma(bytes, n);
        return true;
    }
    board->sending = true;
    board->send_ended = false;
    LINK_USART->SR = ~USART_SR_TC; /* DMA does not clear it, and link_flush() waits for it */
    LINK_DMA_CLEAR = LINK_DMA_CLEAR_ALL;
    LINK_DMA_STREAM.PAR = (uint32_t)&LINK_USART->DR;
    LINK_DMA_STREAM.M0AR = (uint32_t)bytes;
    LINK_DMA_STREAM.NDTR = n;
    barrier(); /* the bytes are in memory before the controller reads them */
    LINK_DMA_STREAM.CR = DMA_SxCR_CHSEL(LINK_DMA_CHANNEL) | DMA_SxCR_MINC | DMA_SxCR_DIR_TO_PERIPHERAL |
                         DMA_SxCR_TCIE | DMA_SxCR_TEIE | DMA_SxCR_EN;
    return true;
}

bool board_link_sending(struct board *board) {
    return board->sending;
}

/* Waits until the last bit of what is being sent has left, for at most a second. */
void link_flush(struct board *board) {
    const uint32_t start_us = board_now_us(board);
    while ((board->sending || (LINK_USART->SR & USART_SR_TC) == 0) &&
           board_now_us(board) - start_us < 1000000u) {
    }
}
