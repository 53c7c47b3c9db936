/* The pyboard v1.1: what its crystal is and where its pins lead. */
#ifndef BOARD_PINS_H
#define BOARD_PINS_H

#define BOARD_ID         WIRE_BOARD_PYBOARD_V11
#define BOARD_CRYSTAL_HZ 12000000u

#define BOARD_SPI_SCK  PIN('A', 5) /* X6 */
#define BOARD_SPI_MISO PIN('A', 6) /* X7 */
#define BOARD_SPI_MOSI PIN('A', 7) /* X8 */
#define BOARD_SEL_CLK  PIN('C', 4) /* X11 */
#define BOARD_SEL_DATA PIN('C', 5) /* X12 */

#define BOARD_LINK_USART 2
#define BOARD_LINK_TX    PIN('A', 2) /* X3 */
#define BOARD_LINK_RX    PIN('A', 3) /* X4 */

#define BOARD_LED PIN('B', 4) /* blue, lit when high */

#endif
