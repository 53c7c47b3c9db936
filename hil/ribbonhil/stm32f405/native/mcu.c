/* The MCU as a whole: memory, power, reset, and what its owner asks for. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "machine.h"

/* RCC_CSR flags: pin, brown-out and power-on. */
#define RESET_FLAGS_POWER_ON 0x0E000000u
#define RESET_FLAG_PIN       0x04000000u

/* What the factory left in system memory. */
#define UNIQUE_ID_OFFSET        0x7A10u
#define TEMPERATURE_30_C_OFFSET 0x7A2Cu
#define BOOT_LOADER_CODE        0x100u

uint64_t mcu_random(struct mcu *mcu) {
    /* xorshift64*, G. Marsaglia, S. Vigna */
    mcu->random ^= mcu->random >> 12;
    mcu->random ^= mcu->random << 25;
    mcu->random ^= mcu->random >> 27;
    return mcu->random * 0x2545F4914F6CDD1Dull;
}

void mcu_forbid(struct mcu *mcu, const char *format, ...) {
    if (mcu->counters.violations++ == 0) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(mcu->violation, sizeof mcu->violation, format, arguments);
        va_end(arguments);
    }
}

const char *mcu_violation(const struct mcu *mcu) {
    return mcu->violation;
}

static void fill_system_memory(struct mcu *mcu) {
    memset(mcu->system_memory, 0xFF, SYSTEM_BYTES);
    /* Instead of ST's boot loader: initial stack pointer, entry point, and a loop. */
    const uint32_t vectors[2] = {RAM_START + 0x2000u, SYSTEM_START + BOOT_LOADER_CODE + 1u};
    const uint16_t loop = 0xE7FE; /* b . */
    const uint16_t raw_at_30_and_110_c[2] = {943, 1187};
    memcpy(mcu->system_memory, vectors, sizeof vectors);
    memcpy(mcu->system_memory + BOOT_LOADER_CODE, &loop, sizeof loop);
    memcpy(mcu->system_memory + UNIQUE_ID_OFFSET, mcu->options.unique_id, sizeof mcu->options.unique_id);
    memcpy(mcu->system_memory + TEMPERATURE_30_C_OFFSET, raw_at_30_and_110_c, sizeof raw_at_30_and_110_c);
}

static bool map_memory(struct mcu *mcu) {
    uint8_t *const flash = mcu->flash.memory;
    const uint32_t read_execute = UC_PROT_READ | UC_PROT_EXEC;
    return uc_mem_map_ptr(mcu->uc, FLASH_START, STORE_START - FLASH_START, read_execute, flash) ==
               UC_ERR_OK &&
           uc_mem_map_ptr(mcu->uc, STORE_END, FLASH_START + FLASH_BYTES - STORE_END, read_execute,
                          flash + (STORE_END - FLASH_START)) == UC_ERR_OK &&
           uc_mem_map_ptr(mcu->uc, RAM_START, RAM_BYTES, UC_PROT_ALL, mcu->ram) == UC_ERR_OK &&
           uc_mem_map_ptr(mcu->uc, SYSTEM_START, SYSTEM_BYTES, read_execute, mcu->system_memory) ==
               UC_ERR_OK &&
           peripherals_map(mcu);
}

struct mcu *mcu_new(const uint8_t *image, size_t n, const struct mcu_wiring *wiring,
                    const struct mcu_options *options, const struct mcu_bus *bus) {
    struct mcu *const mcu = calloc(1, sizeof *mcu);
    if (mcu == NULL || n > FLASH_BYTES) {
        free(mcu);
        return NULL;
    }
    mcu->wiring = *wiring;
    mcu->options = *options;
    mcu->bus = *bus;
    mcu->random = options->seed * 2u + 1u;
    mcu->flash.memory = malloc(FLASH_BYTES);
    mcu->ram = malloc(RAM_BYTES);
    mcu->system_memory = malloc(SYSTEM_BYTES);
    if (mcu->flash.memory == NULL || mcu->ram == NULL || mcu->system_memory == NULL || !cpu_open(mcu) ||
        !map_memory(mcu)) {
        mcu_free(mcu);
        return NULL;
    }
    memset(mcu->flash.memory, 0xFF, FLASH_BYTES);
    memcpy(mcu->flash.memory, image, n);
    fill_system_memory(mcu);
    for (size_t i = 0; i < EVENT_COUNT; i++) {
        mcu->events[i] = NEVER;
    }
    if (options->crystal_fails_us != 0) {
        time_schedule(mcu, EVENT_CRYSTAL_FAILS, options->crystal_fails_us * TICKS_PER_US);
    }
    mcu_power_on(mcu);
    return mcu;
}

void mcu_free(struct mcu *mcu) {
    if (mcu == NULL) {
        return;
    }
    if (mcu->uc != NULL) {
        uc_close(mcu->uc);
    }
    free(mcu->flash.memory);
    free(mcu->ram);
    free(mcu->system_memory);
    free(mcu);
}

void mcu_power_on(struct mcu *mcu) {
    for (size_t i = 0; i < RAM_BYTES; i += 8) {
        const uint64_t anything = mcu_random(mcu);
        memcpy(mcu->ram + i, &anything, 8);
    }
    mcu->power_cut = false;
    mcu->flash.cut_in = 0;
    mcu->to_firmware.count = mcu->from_firmware.count = 0;
    mcu->events[EVENT_LINK_RECEIVED] = NEVER;
    rcc_power_on(mcu);
    mcu_reset(mcu, RESET_FLAGS_POWER_ON);
}

/* Everything but memory goes to its reset state; the watchdog too, which only a reset can stop. */
void mcu_reset(struct mcu *mcu, uint32_t rcc_flags) {
    mcu->reset_wanted = false;
    mcu->in_boot_loader = false;
    for (enum event event = 0; event < EVENT_COUNT; event++) {
        if (event != EVENT_CRYSTAL_FAILS && event != EVENT_LINK_RECEIVED) {
            mcu->events[event] = NEVER;
        }
    }
    mcu->syscfg_memrmp = 0;
    mcu->polled = false;
    mcu->last_read = 0;
    rcc_reset(mcu);
    mcu->rcc.csr |= rcc_flags | RESET_FLAG_PIN;
    nvic_reset(mcu);
    systick_reset(mcu);
    gpio_reset(mcu);
    spi_reset(mcu);
    usart_reset(mcu);
    dma_reset(mcu);
    timers_reset(mcu);
    iwdg_reset(mcu);
    adc_reset(mcu);
    flash_reset(mcu);
    cpu_reset(mcu);
}

void mcu_request_reset(struct mcu *mcu, uint32_t rcc_flag) {
    mcu->reset_wanted = true;
    mcu->reset_flag = rcc_flag;
    time_stop_now(mcu);
}

enum mcu_stop mcu_run(struct mcu *mcu, uint64_t t_ns, bool stop_at_reset) {
    mcu->horizon = t_ns / 125 * 42 + (t_ns % 125 * 42 + 124) / 125;
    return cpu_run(mcu, stop_at_reset);
}

uint64_t mcu_now_ns(const struct mcu *mcu) {
    return ticks_to_ns(mcu->now);
}

/* Bytes that follow each other on the link are one thing to wait for. */
uint64_t mcu_next_event_ns(const struct mcu *mcu) {
    if (mcu->in_boot_loader || mcu->power_cut) {
        return NEVER;
    }
    if (!mcu->cpu.asleep) {
        return mcu_now_ns(mcu);
    }
    uint64_t next = NEVER;
    for (size_t i = 0; i < EVENT_COUNT; i++) {
        const uint64_t at = i == EVENT_LINK_SENT ? usart_all_sent(mcu) : mcu->events[i];
        next = at < next ? at : next;
    }
    return next == NEVER ? NEVER : ticks_to_ns(next);
}

uint32_t mcu_device_us(const struct mcu *mcu) {
    return timers_count(mcu, 0);
}

void mcu_read_counters(const struct mcu *mcu, struct mcu_counters *counters) {
    *counters = mcu->counters;
    counters->sleep_ns = ticks_to_ns(mcu->sleep_ticks);
    counters->hclk_hz = rcc_hclk_hz(mcu);
    counters->spi_hz = rcc_pclk_hz(mcu, 2) >> ((mcu->spi.cr1 >> 3 & 7u) + 1u);
    counters->link_baud = mcu->usart.brr == 0 ? 0 : rcc_pclk_hz(mcu, 1) / mcu->usart.brr;
}

size_t mcu_link_write(struct mcu *mcu, const uint8_t *bytes, size_t n) {
    size_t taken = 0;
    while (taken < n && queue_put(&mcu->to_firmware, bytes[taken])) {
        taken++;
    }
    usart_expect(mcu);
    return taken;
}

size_t mcu_link_read(struct mcu *mcu, uint8_t *bytes, size_t capacity) {
    size_t n = 0;
    while (n < capacity && queue_take(&mcu->from_firmware, &bytes[n])) {
        n++;
    }
    return n;
}

bool mcu_is_sending(const struct mcu *mcu) {
    return mcu->events[EVENT_LINK_SENT] != NEVER;
}

bool mcu_led(const struct mcu *mcu) {
    bool high = false;
    return gpio_drives(mcu, mcu->wiring.led, &high) && high;
}

static uint8_t *memory_at(struct mcu *mcu, uint32_t address, size_t n) {
    const struct {
        uint32_t start, bytes;
        uint8_t *memory;
    } regions[] = {{FLASH_START, FLASH_BYTES, mcu->flash.memory},
                   {RAM_START, RAM_BYTES, mcu->ram},
                   {SYSTEM_START, SYSTEM_BYTES, mcu->system_memory}};
    for (size_t i = 0; i < sizeof regions / sizeof regions[0]; i++) {
        const uint32_t offset = address - regions[i].start;
        if (offset < regions[i].bytes && n <= regions[i].bytes - offset) {
            return regions[i].memory + offset;
        }
    }
    return NULL;
}

bool mcu_peek(struct mcu *mcu, uint32_t address, uint8_t *bytes, size_t n) {
    const uint8_t *const memory = memory_at(mcu, address, n);
    if (memory != NULL) {
        memcpy(bytes, memory, n);
    }
    return memory != NULL;
}

/* What the core itself stores; code in RAM is not looked at again. */
bool mcu_write_ram(struct mcu *mcu, uint32_t address, const void *bytes, size_t n) {
    if (address - RAM_START >= RAM_BYTES || n > RAM_BYTES - (address - RAM_START)) {
        return false;
    }
    memcpy(mcu->ram + (address - RAM_START), bytes, n);
    return true;
}

bool mcu_poke(struct mcu *mcu, uint32_t address, const uint8_t *bytes, size_t n) {
    uint8_t *const memory = memory_at(mcu, address, n);
    if (memory != NULL) {
        memcpy(memory, bytes, n);
        cpu_forget_code(mcu);
    }
    return memory != NULL;
}

void mcu_cut_power_in_flash_operation(struct mcu *mcu, uint32_t operations) {
    mcu->flash.cut_in = operations;
}

size_t mcu_log_events(struct mcu *mcu, struct logged_event *events, size_t capacity) {
    const size_t logged = mcu->log_count;
    mcu->log = events;
    mcu->log_capacity = capacity;
    mcu->log_count = 0;
    return logged;
}

void mcu_profile(struct mcu *mcu, uint64_t *instructions) {
    _Static_assert(MCU_PROFILE_COUNT == FLASH_BYTES / 2, "one a halfword");
    mcu->cpu.profile = instructions;
}

void mcu_log(struct mcu *mcu, enum logged_kind kind, uint32_t t_us, uint8_t out, uint8_t in) {
    if (mcu->log_count < mcu->log_capacity) {
        mcu->log[mcu->log_count++] =
            (struct logged_event){.t_us = t_us, .kind = (uint8_t)kind, .out = out, .in = in};
    }
}
