/* Answers line by line what the header makes of bytes; `test_link_golden.py` says what it should be.
 *
 *   frame KEY HEX     decodes a packet: "drop N", or "right TEXT" and what it encodes to again
 *   stream HEX        takes bytes one by one: the packets it finds, and how many pieces it dropped
 *   cobs HEX          the bytes stuffed
 *   blake KEY N HEX   digest of N bytes
 *   crc HEX           checksum
 *   session KEY HEX   key of the session of a HELLO with this payload
 *   cookie KEY HEX    cookie for nonce u64, sessions u32, era u64 and an address, under a secret
 *   weak KEY          1 if it is no random key
 * KEY is 64 or fewer digits, - where there is none; HEX is - where it is empty.
 */
#include "omnimj_link.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 8192

static uint8_t bytes[MOST], stuffed[2 * MOST];
static char word[4][2 * MOST + 2];

static size_t from_hex(const char *text, uint8_t *to)
{
    size_t size = 0;
    unsigned value;
    if (text[0] == '-') {
        return 0;
    }
    while (sscanf(text + 2 * size, "%2x", &value) == 1) {
        to[size++] = (uint8_t)value;
    }
    return size;
}

static void show(const uint8_t *what, size_t size)
{
    size_t i;
    for (i = 0; i < size; i++) {
        printf("%02x", what[i]);
    }
}

/* A float by its bits; one NaN is as good as another. */
static void tell_bits(const char *before, uint32_t bits)
{
    if ((bits & 0x7FFFFFFFu) > 0x7F800000u) {
        printf("%snan", before);
    } else {
        printf("%s%08lx", before, (unsigned long)bits);
    }
}

static void tell_float(const char *before, float value)
{
    omj_reading reading;
    reading.volts = value;
    tell_bits(before, reading.bits);
}

static void long_hex(uint64_t value)
{
    printf(" %08lx%08lx", (unsigned long)(value >> 32), (unsigned long)(value & 0xFFFFFFFFu));
}

static void tell_capabilities(const omj_capabilities *c)
{
    size_t i;
    uint8_t limits[28];
    long_hex(c->nonce);
    long_hex(c->limits_hash);
    long_hex(c->calibration_hash);
    printf(" %lu %u %u ", (unsigned long)c->period_us, c->lock_step, c->wheels);
    omj_put_limits(limits, &c->limits);
    for (i = 0; i < 7; i++) {
        printf("%s%08lx", i ? "," : "", (unsigned long)omj_get(limits + 4 * i, 4));
    }
    printf(" ");
    for (i = 0; i < c->channels; i++) {
        printf("%s%u/%u/%u", i ? "," : "", c->channel[i].quantity, c->channel[i].wheel, c->channel[i].raw);
    }
}

static void tell_telemetry(const omj_telemetry *t)
{
    size_t i;
    printf(" %lu %lu %u %u", (unsigned long)t->acknowledged, (unsigned long)t->command_age_us, t->status, t->fault);
    printf(" %lu %lu %08lx ", (unsigned long)t->refused, (unsigned long)t->dropped, (unsigned long)t->counts);
    for (i = 0; i < t->channels; i++) {
        if (t->counts >> i & 1u) {
            printf("%s%08lx", i ? "," : "", (unsigned long)t->raw[i].bits);
        } else {
            tell_bits(i ? "," : "", t->raw[i].bits);
        }
    }
}

static void tell(const omj_frame *f)
{
    size_t i;
    char digits[24];
    uint64_t time = f->time_us;
    int at = 23;
    digits[at] = 0;
    do {
        digits[--at] = (char)('0' + (int)(time % 10u));
        time /= 10u;
    } while (time);
    printf("%u %lu %lu %s", f->type, (unsigned long)f->session, (unsigned long)f->sequence, digits + at);
    printf(" %u %u", f->authentic, f->same_schema);
    if (f->type == OMJ_PING || f->type == OMJ_PONG) {
        long_hex(f->of.nonce);
    } else if (f->type == OMJ_HELLO || f->type == OMJ_CHALLENGE) {
        long_hex(f->of.hello.nonce);
        long_hex(f->of.hello.cookie);
        long_hex(f->of.hello.device);
    } else if (f->type == OMJ_RESET) {
        printf(" %lu", (unsigned long)f->of.seen);
    } else if (f->type == OMJ_CAPABILITIES) {
        tell_capabilities(&f->of.capabilities);
    } else if (f->type == OMJ_ARM) {
        long_hex(f->of.arm.limits_hash);
        long_hex(f->of.arm.calibration_hash);
        printf(" %lu", (unsigned long)f->of.arm.telemetry);
    } else if (f->type == OMJ_COMMAND) {
        tell_float(" ", f->of.command.valid_for);
        printf(" %u %lu ", f->of.command.brake, (unsigned long)f->of.command.telemetry);
        for (i = 0; i < f->of.command.wheels; i++) {
            tell_float(i ? "," : "", f->of.command.current[i]);
        }
    } else if (f->type == OMJ_TELEMETRY) {
        tell_telemetry(&f->of.telemetry);
    } else if (f->type == OMJ_FAULT) {
        const omj_fault *fault = &f->of.fault;
        printf(" %u %u %u", fault->code, fault->wheel, fault->latched);
        tell_float(" ", fault->value);
        tell_float(" ", fault->limit);
        printf(" %lu", (unsigned long)fault->sequence);
    }
}

static void frame(void)
{
    uint8_t key[OMJ_KEY_SIZE], again[OMJ_LONGEST_FRAME];
    omj_frame found;
    size_t keyed = from_hex(word[1], key), size = from_hex(word[2], bytes);
    enum omj_drop drop;
    memset(&found, 0xA5, sizeof found);
    drop = omj_decode(bytes, size, keyed ? key : NULL, &found);
    if (drop != OMJ_RIGHT) {
        printf("drop %d\n", (int)drop);
        return;
    }
    printf("right ");
    tell(&found);
    printf("|");
    show(again, omj_encode(&found, found.authentic ? key : NULL, again));
    printf("\n");
}

static void stream(void)
{
    omj_stream line;
    size_t i, found, size = from_hex(word[1], bytes);
    memset(&line, 0, sizeof line);
    for (i = 0; i < size; i++) {
        found = omj_stream_take(&line, bytes[i]);
        if (found) {
            show(line.bytes, found);
            printf(" ");
        }
    }
    printf("dropped %lu\n", (unsigned long)line.dropped);
}

int main(void)
{
    uint8_t key[64], digest[32];
    size_t size, keyed, length;
    while (scanf("%16385s", word[0]) == 1) {
        if (strcmp(word[0], "frame") == 0 && scanf("%16385s %16385s", word[1], word[2]) == 2) {
            frame();
        } else if (strcmp(word[0], "stream") == 0 && scanf("%16385s", word[1]) == 1) {
            stream();
        } else if (strcmp(word[0], "cobs") == 0 && scanf("%16385s", word[1]) == 1) {
            size = from_hex(word[1], bytes);
            show(stuffed, omj_cobs_encode(bytes, size, stuffed));
            printf("\n");
        } else if (strcmp(word[0], "blake") == 0 && scanf("%16385s %16385s %16385s", word[1], word[2], word[3]) == 3) {
            keyed = from_hex(word[1], key);
            length = (size_t)atoi(word[2]);
            size = from_hex(word[3], bytes);
            omj_blake2s(digest, length, key, keyed, bytes, size);
            show(digest, length);
            printf("\n");
        } else if (strcmp(word[0], "session") == 0 && scanf("%16385s %16385s", word[1], word[2]) == 2) {
            omj_hello hello;
            from_hex(word[1], key);
            from_hex(word[2], bytes);
            hello.nonce = omj_get(bytes, 8);
            hello.cookie = omj_get(bytes + 8, 8);
            hello.device = omj_get(bytes + 16, 8);
            omj_session_key(digest, key, &hello);
            show(digest, 32);
            printf("\n");
        } else if (strcmp(word[0], "cookie") == 0 && scanf("%16385s %16385s", word[1], word[2]) == 2) {
            from_hex(word[1], key);
            size = from_hex(word[2], bytes);
            long_hex(omj_cookie(key, omj_get(bytes, 8), (uint32_t)omj_get(bytes + 8, 4), omj_get(bytes + 12, 8),
                                bytes + 20, size - 20));
            printf("\n");
        } else if (strcmp(word[0], "weak") == 0 && scanf("%16385s", word[1]) == 1) {
            from_hex(word[1], key);
            printf("%d\n", omj_is_weak_key(key));
        } else if (strcmp(word[0], "crc") == 0 && scanf("%16385s", word[1]) == 1) {
            size = from_hex(word[1], bytes);
            printf("%08lx\n", (unsigned long)omj_crc32(bytes, size));
        } else {
            return 1;
        }
    }
    return 0;
}
