/* The Feather STM32F405 Express: what its crystal is and where its pins lead. */
#ifndef BOARD_PINS_H
#define BOARD_PINS_H

#define BOARD_ID         WIRE_BOARD_FEATHER_F405
#define BOARD_CRYSTAL_HZ 12000000u

/* The header's own SCK, MISO and MOSI belong to SPI2; SPI1 is on A1 to A3, as on the pyboard's X6 to X8. */
#define BOARD_SPI_SCK  PIN('A', 5) /* A1 */
#define BOARD_SPI_MISO PIN('A', 6) /* A2 */
#define BOARD_SPI_MOSI PIN('A', 7) /* A3 */
#define BOARD_SEL_CLK  PIN('C', 4) /* A4 */
#define BOARD_SEL_DATA PIN('C', 5) /* A5 */

/* USART2 does not reach the header. */
#define BOARD_LINK_USART 3
#define BOARD_LINK_TX    PIN('B', 10) /* TX */
#define BOARD_LINK_RX    PIN('B', 11) /* RX */

#define BOARD_LED PIN('C', 1) /* red, lit when high */

#endif
