/* ADC1 with the temperature sensor on channel 16 (RM0090, 13): one conversion by software. */
#include "machine.h"

enum {
    SR = 0x000,
    CR1 = 0x004,
    CR2 = 0x008,
    SMPR1 = 0x00C,
    SQR1 = 0x02C,
    SQR3 = 0x034,
    DR = 0x04C,
    CCR = 0x304
};

#define SR_EOC      (1u << 1)
#define CR2_ADON    (1u << 0)
#define CR2_SWSTART (1u << 30)
#define CCR_TSVREFE (1u << 23)
#define CHANNEL     16u
#define ADC_HZ_MAX  36000000u
#define SAMPLE_US   10u /* data sheet DS8626, table 69 */

/* Raw readings at 30 and 110 degC, as in mcu.c's system memory. */
#define RAW_30_C        943.0
#define RAW_OF_A_DEGREE (244.0 / 80.0)

void adc_reset(struct mcu *mcu) {
    mcu->adc = (struct adc){0};
}

static uint32_t adc_hz(const struct mcu *mcu) {
    return rcc_pclk_hz(mcu, 2) / (2u * ((mcu->adc.ccr >> 16 & 3u) + 1u));
}

static void convert(struct mcu *mcu) {
    static const uint32_t SAMPLE_CYCLES[8] = {3, 15, 28, 56, 84, 112, 144, 480};
    struct adc *const adc = &mcu->adc;
    const uint32_t sample = SAMPLE_CYCLES[adc->smpr1 >> 18 & 7u];
    if ((adc->cr2 & CR2_ADON) == 0 || (adc->ccr & CCR_TSVREFE) == 0 || (adc->sqr3 & 31u) != CHANNEL ||
        adc_hz(mcu) > ADC_HZ_MAX || sample * 1000000ull < (uint64_t)SAMPLE_US * adc_hz(mcu)) {
        mcu_forbid(mcu, "ADC conversion that does not give a temperature");
        return;
    }
    adc->converting = true;
    adc->end_of_conversion = false;
    adc->done = mcu->now + (sample + 12u) * TICKS_HZ / adc_hz(mcu);
}

static void catch_up(struct mcu *mcu) {
    if (mcu->adc.converting && mcu->now >= mcu->adc.done) {
        mcu->adc.converting = false;
        mcu->adc.end_of_conversion = true;
    }
}

uint32_t adc_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    struct adc *const adc = &mcu->adc;
    switch (offset) {
    case SR:
        if (adc->converting) {
            time_warp(mcu, adc->done);
        }
        catch_up(mcu);
        return adc->end_of_conversion ? SR_EOC : 0;
    case CR1:
        return adc->cr1;
    case CR2:
        return adc->cr2;
    case SMPR1:
        return adc->smpr1;
    case SQR1:
        return adc->sqr1;
    case SQR3:
        return adc->sqr3;
    case CCR:
        return adc->ccr;
    case DR:
        catch_up(mcu);
        adc->end_of_conversion = false;
        return (uint32_t)(RAW_30_C + RAW_OF_A_DEGREE * ((double)mcu->options.temperature_c - 30.0) + 0.5);
    default:
        mcu_forbid(mcu, "read of ADC register %#x, which is not modelled", offset);
        return 0;
    }
}

void adc_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    struct adc *const adc = &mcu->adc;
    switch (offset) {
    case SR:
        adc->end_of_conversion = adc->end_of_conversion && (value & SR_EOC) != 0;
        break;
    case CR1:
        adc->cr1 = value;
        break;
    case CR2:
        adc->cr2 = value & ~CR2_SWSTART;
        if ((value & CR2_SWSTART) != 0) {
            convert(mcu);
        }
        break;
    case SMPR1:
        adc->smpr1 = value;
        break;
    case SQR1:
        adc->sqr1 = value;
        break;
    case SQR3:
        adc->sqr3 = value;
        break;
    case CCR:
        adc->ccr = value;
        break;
    default:
        mcu_forbid(mcu, "write to ADC register %#x, which is not modelled", offset);
        break;
    }
}
