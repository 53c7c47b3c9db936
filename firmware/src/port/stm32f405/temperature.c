/* The MCU's own thermometer, read with the two points the factory measured. */
#include <math.h>

#include "port.h"

#define POLLS_MAX 10000u /* one conversion takes 492 cycles of 21 MHz */

void temperature_start(void) {
    RCC->APB2ENR |= RCC_APB2ENR_ADC1EN;
    (void)RCC->APB2ENR;
    ADC_COMMON->CCR = ADC_COMMON_CCR_ADCPRE_4 | ADC_COMMON_CCR_TSVREFE;
    ADC1->SMPR1 = ADC_SMPR1_SMP16_480; /* 22.9 us; the sensor asks for 10 */
    ADC1->SQR1 = 0;
    ADC1->SQR3 = ADC_SQR3_SQ1(ADC_CHANNEL_TEMPERATURE);
    ADC1->CR2 = ADC_CR2_ADON;
}

/* The points were taken at a supply of 3.3 V, which is taken for granted here. */
float board_temperature_c(struct board *board) {
    if (!board->clocks.answered) {
        return NAN;
    }
    ADC1->SR = 0;
    ADC1->CR2 |= ADC_CR2_SWSTART;
    if (!poll_until(&ADC1->SR, ADC_SR_EOC, ADC_SR_EOC, POLLS_MAX)) {
        return NAN;
    }
    const float raw = (float)ADC1->DR;
    const float raw_30 = (float)TEMPERATURE_RAW_30_C;
    const float raw_110 = (float)TEMPERATURE_RAW_110_C;
    return raw_110 > raw_30 ? 30.0f + 80.0f * (raw - raw_30) / (raw_110 - raw_30) : NAN;
}
