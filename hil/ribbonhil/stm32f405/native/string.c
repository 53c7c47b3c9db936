/* The wires of the sensor string: from pins to select clocks and bytes. */
#include "machine.h"

#define SPI_FUNCTION 5u

/* The chain moves when SEL_CLK rises. A pin that drives nothing is held low by the string's pull-down. */
void string_pins_changed(struct mcu *mcu) {
    bool clock = false;
    bool data = false;
    clock = gpio_drives(mcu, mcu->wiring.sel_clk, &clock) && clock;
    const bool rises = clock && !mcu->sel_clk_high;
    mcu->sel_clk_high = clock;
    if (!rises) {
        return;
    }
    data = gpio_drives(mcu, mcu->wiring.sel_data, &data) && data;
    const uint64_t t_ns = ticks_to_ns(mcu->now);
    mcu->counters.bus_pulses++;
    mcu_log(mcu, LOGGED_PULSE, 0, data, 0);
    mcu->bus.select_clock(mcu->bus.context, t_ns, data);
}

/* A byte that ends at `end`. Without its pins the SPI talks to nobody, and hears its pull-up. */
uint8_t string_transfer(struct mcu *mcu, uint64_t end, uint8_t mosi) {
    mcu->counters.bus_bytes++;
    if (!gpio_is_alternate(mcu, mcu->wiring.spi_sck, SPI_FUNCTION) ||
        !gpio_is_alternate(mcu, mcu->wiring.spi_mosi, SPI_FUNCTION)) {
        mcu_forbid(mcu, "SPI transfer while its pins are not given to it");
        return 0xFF;
    }
    const uint64_t t_ns = ticks_to_ns(end);
    const uint8_t miso = mcu->bus.transfer(mcu->bus.context, t_ns, mosi);
    const uint8_t read = gpio_is_alternate(mcu, mcu->wiring.spi_miso, SPI_FUNCTION) ? miso : 0xFF;
    mcu_log(mcu, LOGGED_BYTE, 0, mosi, read);
    return read;
}
