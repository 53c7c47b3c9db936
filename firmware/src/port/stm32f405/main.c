/* Runs the application for ever. */
#include "app_state.h"
#include "port.h"

struct board the_board;

int main(void) {
    static struct app app;
    board_start(&the_board);
    app_init(&app, &the_board);
    for (;;) {
        app_poll(&app);
    }
}
