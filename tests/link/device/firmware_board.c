/* A board for the firmware example: time, bytes and readings come from standard input, line by line.
 *
 *   excess F  amplifier 1 carries so much more than its set value [A]
 *   speed F   wheel 1 turns so fast      bytes HEX   come on the line       turn US   time goes on, one turn
 * Each turn answers: bytes sent (or -), enable, current of wheel 1.
 */
#include "firmware_example.c"

#include <stdio.h>
#include <string.h>

static uint64_t clock_us = 1000000u;
static uint8_t coming[8192];
static size_t begin, end;
static float speed_1, current_1, excess_1, applied[WHEELS];
static int enabled;
static char word[20000], digits[20000];
static size_t sent;

uint64_t board_now_us(void) { return clock_us; }

uint32_t board_random(void)
{
    static uint32_t state = 77;
    return state = state * 1664525u + 1013904223u;
}

void board_read(omj_reading *raw, float *speed, float *current)
{
    size_t i;
    for (i = 0; i < CHANNELS; i++) {
        raw[i].volts = 0.5f * (float)i;
    }
    raw[11].counts = -4096;
    for (i = 0; i < WHEELS; i++) {
        speed[i] = i ? 0.0f : speed_1;
        current[i] = applied[i] + (i ? 0.0f : excess_1);
    }
}

void board_amplifiers(const float *current, uint8_t brake, int enable)
{
    memcpy(applied, current, sizeof applied);
    current_1 = current[0];
    enabled = enable && !brake;
}

int board_receive(uint8_t *byte)
{
    if (begin == end) {
        return 0;
    }
    *byte = coming[begin++];
    return 1;
}

void board_send(const uint8_t *bytes, size_t size)
{
    size_t i;
    for (i = 0; i < size; i++) {
        sent += (size_t)sprintf(digits + sent, "%02x", bytes[i]);
    }
}

int main(void)
{
    unsigned value;
    unsigned long us;
    size_t i;
    firmware_begin();
    while (scanf("%19999s", word) == 1) {
        if (strcmp(word, "speed") == 0 && scanf("%19999s", word) == 1) {
            speed_1 = 0.0f;
            if (strcmp(word, "nan") == 0) {
                speed_1 = omj_get_float((const uint8_t *)"\x00\x00\xc0\x7f");
            } else if (sscanf(word, "%f", &speed_1) != 1) {
                return 1;
            }
        } else if (strcmp(word, "excess") == 0 && scanf("%f", &excess_1) == 1) {
            continue;
        } else if (strcmp(word, "bytes") == 0 && scanf("%19999s", word) == 1) {
            begin = end = 0;
            for (i = 0; sscanf(word + 2 * i, "%2x", &value) == 1; i++) {
                coming[end++] = (uint8_t)value;
            }
        } else if (strcmp(word, "turn") == 0 && scanf("%lu", &us) == 1) {
            clock_us += us;
            sent = 0;
            digits[0] = 0;
            firmware_turn();
            printf("%s %d %g\n", sent ? digits : "-", enabled, (double)current_1);
            fflush(stdout);
        } else {
            return 1;
        }
    }
    return 0;
}
