/* Registers of the HMC5983 magnetometer (Honeywell data sheet 900425), as far as they are used.
 *
 * The one definition for the driver and for the emulator's model of the part; no conversions here. */
#ifndef HMC5983_REGS_H
#define HMC5983_REGS_H

/* SPI mode 3, at most 8 MHz: bit 7 of the first byte is read (1) or write (0), bit 6 lets the address advance
 * by itself, bits 5 to 0 the address. */
#define HMC5983_SPI_READ         0x80u
#define HMC5983_SPI_INCREMENT    0x40u
#define HMC5983_SPI_ADDRESS_MASK 0x3Fu

#define HMC5983_CONFIG_A       0x00u
#define HMC5983_CONFIG_A_RESET 0x10u
#define HMC5983_CONFIG_A_TS    0x80u /* temperature sensor, and compensation of the field's scale with it */
#define HMC5983_CONFIG_A_MA_SHIFT 5u /* codes 0 to 3: 1, 2, 4, 8 measurements averaged */
#define HMC5983_CONFIG_A_MA_MASK  0x60u
/* Output data rate in continuous mode, codes 0 to 7: 0.75, 1.5, 3, 7.5, 15, 30, 75, 220 Hz. */
#define HMC5983_CONFIG_A_DO_SHIFT 2u
#define HMC5983_CONFIG_A_DO_MASK  0x1Cu
#define HMC5983_CONFIG_A_MS_MASK  0x03u

#define HMC5983_CONFIG_B          0x01u
#define HMC5983_CONFIG_B_RESET    0x20u
#define HMC5983_CONFIG_B_GN_SHIFT 5u

#define HMC5983_MODE            0x02u
#define HMC5983_MODE_RESET      0x01u
#define HMC5983_MODE_MD_MASK    0x03u
#define HMC5983_MODE_CONTINUOUS 0x00u
#define HMC5983_MODE_SINGLE     0x01u /* starts one measurement; reads as idle when it has ended */
#define HMC5983_MODE_IDLE       0x02u

#define HMC5983_OUT_X_MSB 0x03u /* X, Z, Y (in this order), high byte first, two's complement */
#define HMC5983_OUT_Y_LSB 0x08u

#define HMC5983_STATUS      0x09u
#define HMC5983_STATUS_RDY  0x01u /* after a single measurement, until the outputs are read */
#define HMC5983_STATUS_LOCK 0x02u
#define HMC5983_STATUS_DOW  0x10u

#define HMC5983_ID_A       0x0Au /* three registers that read H43 */
#define HMC5983_ID_A_VALUE 0x48u
#define HMC5983_ID_B_VALUE 0x34u
#define HMC5983_ID_C_VALUE 0x33u

#define HMC5983_TEMPERATURE_MSB 0x31u

#define HMC5983_COUNT_MAX      2047
#define HMC5983_COUNT_MIN      (-2048)
#define HMC5983_COUNT_OVERFLOW (-4096) /* an axis beyond its range */

/* Counts a gauss by gain code 0 to 7: ranges of 0.88, 1.3, 1.9, 2.5, 4.0, 4.7, 5.6, 8.1 G. */
#define HMC5983_COUNTS_PER_GAUSS {1370.0f, 1090.0f, 820.0f, 660.0f, 440.0f, 390.0f, 330.0f, 230.0f}

#define HMC5983_MEASUREMENT_US   4500u /* of a single measurement, one sample */
#define HMC5983_NOISE_MILLIGAUSS 2.0f
#define HMC5983_POWER_UP_US      10000u

#endif
