/* Pins (RM0090, 8): a pin drives only what its mode says. */
#include "machine.h"

enum {
    MODER = 0x00,
    OTYPER = 0x04,
    OSPEEDR = 0x08,
    PUPDR = 0x0C,
    IDR = 0x10,
    ODR = 0x14,
    BSRR = 0x18,
    AFRL = 0x20,
    AFRH = 0x24
};
enum { MODE_OUTPUT = 1, MODE_ALTERNATE = 2 };

void gpio_reset(struct mcu *mcu) {
    mcu->gpio[0] = (struct gpio){.moder = 0xA8000000u, .pupdr = 0x64000000u};
    mcu->gpio[1] = (struct gpio){.moder = 0x00000280u, .ospeedr = 0x000000C0u, .pupdr = 0x00000100u};
    mcu->gpio[2] = (struct gpio){0};
}

static uint32_t mode(const struct gpio *gpio, unsigned number) {
    return gpio->moder >> 2 * number & 3u;
}

bool gpio_is_alternate(const struct mcu *mcu, uint8_t pin, uint32_t function) {
    const struct gpio *const gpio = &mcu->gpio[pin >> 4];
    const unsigned number = pin & 15u;
    return mode(gpio, number) == MODE_ALTERNATE &&
           (gpio->afr[number >> 3] >> 4 * (number & 7u) & 15u) == function;
}

bool gpio_drives(const struct mcu *mcu, uint8_t pin, bool *high) {
    const struct gpio *const gpio = &mcu->gpio[pin >> 4];
    *high = (gpio->odr >> (pin & 15u) & 1u) != 0;
    return mode(gpio, pin & 15u) == MODE_OUTPUT;
}

uint32_t gpio_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    const struct gpio *const gpio = &mcu->gpio[instance];
    switch (offset) {
    case MODER:
        return gpio->moder;
    case OTYPER:
        return gpio->otyper;
    case OSPEEDR:
        return gpio->ospeedr;
    case PUPDR:
        return gpio->pupdr;
    case IDR: {
        uint32_t levels = 0;
        for (unsigned number = 0; number < 16; number++) {
            const bool pulled_up = (gpio->pupdr >> 2 * number & 3u) == 1;
            const bool driven_high = mode(gpio, number) == MODE_OUTPUT && (gpio->odr >> number & 1u) != 0;
            levels |= (pulled_up && mode(gpio, number) != MODE_OUTPUT) || driven_high ? 1u << number : 0;
        }
        return levels;
    }
    case ODR:
        return gpio->odr;
    case BSRR:
        return 0;
    case AFRL:
    case AFRH:
        return gpio->afr[(offset - AFRL) / 4];
    default:
        mcu_forbid(mcu, "read of GPIO register %#x, which is not modelled", offset);
        return 0;
    }
}

void gpio_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    struct gpio *const gpio = &mcu->gpio[instance];
    switch (offset) {
    case MODER:
        gpio->moder = value;
        break;
    case OTYPER:
        gpio->otyper = value;
        break;
    case OSPEEDR:
        gpio->ospeedr = value;
        break;
    case PUPDR:
        gpio->pupdr = value;
        break;
    case ODR:
        gpio->odr = value & 0xFFFFu;
        break;
    case BSRR: /* where a bit is set and reset at once, setting wins */
        gpio->odr = (gpio->odr & ~(value >> 16)) | (value & 0xFFFFu);
        break;
    case AFRL:
    case AFRH:
        gpio->afr[(offset - AFRL) / 4] = value;
        break;
    default:
        mcu_forbid(mcu, "write to GPIO register %#x, which is not modelled", offset);
        break;
    }
    string_pins_changed(mcu);
}
