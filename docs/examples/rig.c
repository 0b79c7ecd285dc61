#include <stdio.h>
#include "controller/observer.h"

int main(void)
{
    static observer_state state;
    static observer_in in;
    static observer_out out;
    observer_init(&state);
    for (int step = 0; step < 7200; step++) {
        for (int i = 0; i < 5; i++) {
            in.reading[OBSERVER_READING_T1_DEGC + i] = 25.0;
            in.fresh[OBSERVER_READING_T1_DEGC + i] = i != 2 || step < 3600;
        }
        in.reading[OBSERVER_READING_NUT_POSITION_M] = 0.5;
        in.reading[OBSERVER_READING_SCREW_SPEED_RPM] = 0.0;
        in.reading[OBSERVER_READING_AMBIENT_DEGC] = 25.0;
        in.fresh[OBSERVER_READING_NUT_POSITION_M] = in.fresh[OBSERVER_READING_SCREW_SPEED_RPM] = true;
        in.fresh[OBSERVER_READING_AMBIENT_DEGC] = true;
        observer_step(&state, &in, &out);
        if (step == 3599 || step == 7199)
            printf("quality %d, armed %d; t3: quality %d, silent for %.0f s\n", (int)out.quality,
                   (int)out.armed, (int)out.sensor_quality[2], (double)out.age_s[2]);
    }
    return 0;
}
