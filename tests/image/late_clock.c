/* The firmware, started two seconds before its microsecond clock wraps, as it does every 71.6 minutes. */
#include "app_state.h"
#include "port.h"

struct board the_board;

int main(void) {
    static struct app app;
    board_start(&the_board);
    TIM2->CNT = 0u - 2000000u;
    app_init(&app, &the_board);
    for (;;) {
        app_poll(&app);
    }
}
