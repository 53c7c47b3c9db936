/* Pins by number: PIN(port letter, number). */
#include "port.h"

static void set_field(volatile uint32_t *r, uint32_t index, uint32_t width, uint32_t value) {
    const uint32_t shift = index * width;
    *r = (*r & ~(((1u << width) - 1u) << shift)) | value << shift;
}

enum { MODE_OUTPUT = 1, MODE_ALTERNATE = 2, SPEED_MEDIUM = 1, PULL_UP = 1 };

void gpio_start(void) {
    RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN;
    (void)RCC->AHB1ENR; /* the clock is on two cycles after the write */
}

void gpio_set_up_output(uint32_t pin) {
    set_field(&gpio_port(pin)->OSPEEDR, pin & 15u, 2, SPEED_MEDIUM);
    set_field(&gpio_port(pin)->MODER, pin & 15u, 2, MODE_OUTPUT);
}

void gpio_set_up_alternate(uint32_t pin, uint32_t function) {
    const uint32_t n = pin & 15u;
    struct gpio_registers *const gpio = gpio_port(pin);
    set_field(n < 8 ? &gpio->AFRL : &gpio->AFRH, n & 7u, 4, function);
    set_field(&gpio->OSPEEDR, n, 2, SPEED_MEDIUM);
    set_field(&gpio->MODER, n, 2, MODE_ALTERNATE);
}

void gpio_pull_up(uint32_t pin) {
    set_field(&gpio_port(pin)->PUPDR, pin & 15u, 2, PULL_UP);
}
