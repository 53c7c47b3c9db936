/* Registers of the MMC5983MA magnetometer (MEMSIC data sheet rev. A), as far as they are used.
 *
 * The one definition for the driver and for the emulator's model of the part; no conversions here. */
#ifndef MMC5983MA_REGS_H
#define MMC5983MA_REGS_H

/* SPI mode 0 or 3, at most 10 MHz: bit 7 of the first byte is read (1) or write (0), bits 5 to 0 the address,
 * which advances by itself. The four control registers can only be written. */
#define MMC5983MA_SPI_READ         0x80u
#define MMC5983MA_SPI_ADDRESS_MASK 0x3Fu

#define MMC5983MA_XOUT0   0x00u /* X bits 17 to 10 */
#define MMC5983MA_XOUT1   0x01u /* X bits 9 to 2 */
#define MMC5983MA_YOUT0   0x02u
#define MMC5983MA_YOUT1   0x03u
#define MMC5983MA_ZOUT0   0x04u
#define MMC5983MA_ZOUT1   0x05u
#define MMC5983MA_XYZOUT2 0x06u /* X bits 1 to 0 at 7 to 6, Y at 5 to 4, Z at 3 to 2 */
#define MMC5983MA_TOUT    0x07u /* 0.8 degC a count, 0 is -75 degC */

#define MMC5983MA_STATUS               0x08u
#define MMC5983MA_STATUS_MEAS_M_DONE   0x01u /* cleared when TM_M starts a measurement */
#define MMC5983MA_STATUS_MEAS_T_DONE   0x02u
#define MMC5983MA_STATUS_OTP_READ_DONE 0x10u /* the trimming was read after power-up */

#define MMC5983MA_CONTROL0                  0x09u
#define MMC5983MA_CONTROL0_TM_M             0x01u /* starts a magnetic measurement, clears itself */
#define MMC5983MA_CONTROL0_TM_T             0x02u
#define MMC5983MA_CONTROL0_INT_MEAS_DONE_EN 0x04u
#define MMC5983MA_CONTROL0_SET              0x08u /* current pulse through the coil, clears itself */
#define MMC5983MA_CONTROL0_RESET            0x10u /* the other way round: the field reads reversed */
#define MMC5983MA_CONTROL0_AUTO_SR_EN       0x20u
#define MMC5983MA_CONTROL0_OTP_READ         0x40u

#define MMC5983MA_CONTROL1            0x0Au
#define MMC5983MA_CONTROL1_BW_MASK    0x03u
#define MMC5983MA_CONTROL1_X_INHIBIT  0x04u
#define MMC5983MA_CONTROL1_YZ_INHIBIT 0x18u
#define MMC5983MA_CONTROL1_SW_RESET   0x80u

#define MMC5983MA_CONTROL2            0x0Bu
#define MMC5983MA_CONTROL2_CONTINUOUS 0x08u

#define MMC5983MA_CONTROL3        0x0Cu
#define MMC5983MA_CONTROL3_SPI_3W 0x40u

#define MMC5983MA_PRODUCT_ID       0x2Fu
#define MMC5983MA_PRODUCT_ID_VALUE 0x30u

#define MMC5983MA_COUNT_BITS       18
#define MMC5983MA_NULL_FIELD_COUNT 131072
#define MMC5983MA_COUNT_MAX        262143
#define MMC5983MA_COUNTS_PER_GAUSS 16384.0f /* +-8 G full scale; 1 G = 100 uT */

/* By BW code, 0 to 3: time of a measurement and total RMS noise. */
#define MMC5983MA_MEASUREMENT_US   {8000u, 4000u, 2000u, 500u}
#define MMC5983MA_NOISE_MILLIGAUSS {0.4f, 0.6f, 0.8f, 1.2f}

/* Largest offset of the bridge, seen with the same sign after SET and RESET: +-0.5 G null field output. */
#define MMC5983MA_OFFSET_MAX_GAUSS 0.5f

#define MMC5983MA_POWER_UP_US  10000u /* also after SW_RESET */
#define MMC5983MA_SET_RESET_US 1u     /* the pulse takes 500 ns */

#endif
