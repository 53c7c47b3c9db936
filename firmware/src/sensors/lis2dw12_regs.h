/* Registers of the LIS2DW12 accelerometer (STMicroelectronics data sheet DS11927), as far as they are used.
 *
 * The one definition for the driver and for the emulator's model of the part; no conversions here. */
#ifndef LIS2DW12_REGS_H
#define LIS2DW12_REGS_H

/* SPI mode 3, at most 10 MHz: bit 7 of the first byte is read (1) or write (0), bits 6 to 0 the address,
 * which then advances by itself if CTRL2 IF_ADD_INC is set. */
#define LIS2DW12_SPI_READ         0x80u
#define LIS2DW12_SPI_ADDRESS_MASK 0x7Fu

#define LIS2DW12_OUT_T_L        0x0Du
#define LIS2DW12_OUT_T_H        0x0Eu
#define LIS2DW12_WHO_AM_I       0x0Fu
#define LIS2DW12_WHO_AM_I_VALUE 0x44u

#define LIS2DW12_CTRL1                       0x20u
#define LIS2DW12_CTRL1_RESET                 0x00u
#define LIS2DW12_CTRL1_ODR_SHIFT             4u
#define LIS2DW12_CTRL1_ODR_MASK              0xF0u
#define LIS2DW12_CTRL1_MODE_MASK             0x0Cu
#define LIS2DW12_CTRL1_MODE_HIGH_PERFORMANCE 0x04u /* 14 bit */
#define LIS2DW12_CTRL1_LP_MODE_MASK          0x03u

#define LIS2DW12_CTRL2             0x21u
#define LIS2DW12_CTRL2_RESET       0x04u
#define LIS2DW12_CTRL2_BOOT        0x80u /* reloads the trimming, clears itself */
#define LIS2DW12_CTRL2_SOFT_RESET  0x40u /* control registers to their defaults, clears itself */
#define LIS2DW12_CTRL2_CS_PU_DISC  0x10u
#define LIS2DW12_CTRL2_BDU         0x08u /* output not updated until both bytes of it are read */
#define LIS2DW12_CTRL2_IF_ADD_INC  0x04u
#define LIS2DW12_CTRL2_I2C_DISABLE 0x02u
#define LIS2DW12_CTRL2_SIM         0x01u

#define LIS2DW12_CTRL3 0x22u
#define LIS2DW12_CTRL4 0x23u
#define LIS2DW12_CTRL5 0x24u

#define LIS2DW12_CTRL6               0x25u
#define LIS2DW12_CTRL6_RESET         0x00u
#define LIS2DW12_CTRL6_BW_FILT_SHIFT 6u /* codes 0 to 3: output data rate / 2, / 4, / 10, / 20 */
#define LIS2DW12_CTRL6_BW_FILT_MASK  0xC0u
#define LIS2DW12_CTRL6_FS_SHIFT      4u /* codes 0 to 3: 2, 4, 8, 16 g */
#define LIS2DW12_CTRL6_FS_MASK       0x30u
#define LIS2DW12_CTRL6_FDS           0x08u
#define LIS2DW12_CTRL6_LOW_NOISE     0x04u

#define LIS2DW12_STATUS      0x27u
#define LIS2DW12_STATUS_DRDY 0x01u /* a sample not read yet; reading an output's high byte clears it */

#define LIS2DW12_OUT_X_L 0x28u /* X, Y, Z, low byte first, 14 bits left-justified, two's complement */
#define LIS2DW12_OUT_Z_H 0x2Du

/* Output data rate by CTRL1 code, high-performance mode; code 0 is power-down. In millihertz. */
#define LIS2DW12_ODR_CODE_MIN 2u
#define LIS2DW12_ODR_CODE_MAX 9u
#define LIS2DW12_ODR_MILLIHZ                                                                                 \
    {0u, 12500u, 12500u, 25000u, 50000u, 100000u, 200000u, 400000u, 800000u, 1600000u}

/* Divisor of the output data rate that gives the -3 dB bandwidth, by BW_FILT code. */
#define LIS2DW12_BW_DIVISOR {2u, 4u, 10u, 20u}

#define LIS2DW12_COUNT_BITS      14
#define LIS2DW12_COUNT_MAX       8191
#define LIS2DW12_COUNT_MIN       (-8192)
#define LIS2DW12_MG_PER_COUNT_2G 0.244f /* times 2, 4, 8 for the larger ranges */
#define LIS2DW12_RANGE_G         {2u, 4u, 8u, 16u}

/* Noise density in high-performance mode, low noise set, 2 g: ug / sqrt(Hz). */
#define LIS2DW12_NOISE_UG_RTHZ 90.0f

#define LIS2DW12_BOOT_US       20000u /* from power-up to the first access */
#define LIS2DW12_SOFT_RESET_US 100u   /* from SOFT_RESET to the next access */
#define LIS2DW12_ODR_TOLERANCE 0.10f  /* of the output data rate */

#endif
