/* A complete firmware except for the six functions of the board: the rules of PROTOCOL.md, section 4, in order.
 *
 * For a robot of four wheels on a serial line at 500 Hz. Where frames come as UDP datagrams, hand them to on_packet
 * and leave the stuffing out. There is no lock-step here: that is for emulators.
 */
#include "omnimj_link.h"

#define WHEELS 4u
#define CHANNELS 12u
#define PERIOD_US 2000u

uint64_t board_now_us(void);                        /* monotonic */
uint32_t board_random(void);                        /* true random bits */
void board_read(omj_reading *raw, float *speed);    /* all channels at one instant; rad/s after the gear */
void board_amplifiers(const float *current, uint8_t brake, int enable); /* the watchdog line toggles in here */
int board_receive(uint8_t *byte);                   /* 0: no byte available */
void board_send(const uint8_t *bytes, size_t size);

void firmware_begin(void);
void firmware_turn(void);

/* set when the device was commissioned */
static const omj_limits limits = {1.5f, 1000.0f, 0.75f, 0.5f, 40.0f, 2000.0f, 0.2f};
static const uint64_t calibration_hash = 0x0123456789ABCDEFu;
static const omj_channel channels[CHANNELS] = {
    {OMJ_QUANTITY_CURRENT, 1, OMJ_RAW_VOLTS},        {OMJ_QUANTITY_CURRENT, 2, OMJ_RAW_VOLTS},
    {OMJ_QUANTITY_CURRENT, 3, OMJ_RAW_VOLTS},        {OMJ_QUANTITY_CURRENT, 4, OMJ_RAW_VOLTS},
    {OMJ_QUANTITY_WHEEL_SPEED, 1, OMJ_RAW_VOLTS},    {OMJ_QUANTITY_WHEEL_SPEED, 2, OMJ_RAW_VOLTS},
    {OMJ_QUANTITY_WHEEL_SPEED, 3, OMJ_RAW_VOLTS},    {OMJ_QUANTITY_WHEEL_SPEED, 4, OMJ_RAW_VOLTS},
    {OMJ_QUANTITY_ACCELERATION_X, 0, OMJ_RAW_VOLTS}, {OMJ_QUANTITY_ACCELERATION_Y, 0, OMJ_RAW_VOLTS},
    {OMJ_QUANTITY_YAW_RATE, 0, OMJ_RAW_VOLTS},       {OMJ_QUANTITY_YAW, 0, OMJ_RAW_COUNTS}};
static const uint8_t *const key = NULL; /* or 32 bytes */

static omj_stream line;
static uint32_t session, heard, said, refused, dropped, acknowledged, told[64];
static uint64_t told_at[64], arrived, since, last_period, warmed_at, nonce, bucket_at,
    hello_at;
static float newest[WHEELS], flows[WHEELS], heat[WHEELS], valid_for, bucket;
static uint8_t newest_brake, armed, fault, has_command;

static float magnitude(float x) { return x < 0.0f ? -x : x; }
static float seconds(uint64_t us) { return (float)us * 1e-6f; }

static void say(omj_frame *frame)
{
    uint8_t packet[OMJ_LONGEST_FRAME], stuffed[OMJ_LONGEST_STUFFED + 1u];
    size_t size;
    frame->time_us = board_now_us();
    size = omj_encode(frame, key, packet);
    board_send(stuffed, omj_cobs_encode(packet, size, stuffed));
}

static void say_fault(uint8_t code, uint8_t wheel, float value, float limit, uint32_t of, int latched)
{
    omj_frame frame = {0};
    frame.type = OMJ_FAULT;
    frame.session = code == OMJ_FAULT_BUSY ? 0u : session;
    frame.sequence = code == OMJ_FAULT_BUSY ? 0u : ++said;
    frame.of.fault.code = code;
    frame.of.fault.wheel = wheel;
    frame.of.fault.latched = (uint8_t)latched;
    frame.of.fault.value = value;
    frame.of.fault.limit = limit;
    frame.of.fault.sequence = of;
    say(&frame);
}

static void disarm(void)
{
    size_t i;
    armed = has_command = newest_brake = 0;
    for (i = 0; i < WHEELS; i++) {
        newest[i] = flows[i] = 0.0f;
    }
    since = board_now_us();
    board_amplifiers(flows, 0, 0);
}

static void latch(uint8_t code, uint8_t wheel, float value, float limit, uint32_t of)
{
    disarm();
    refused += of != 0;
    fault = fault ? fault : code;
    say_fault(code, wheel, value, limit, of, 1);
}

static void refuse(uint8_t code, float value, float limit, uint32_t of)
{
    refused++;
    say_fault(code, 0, value, limit, of, 0);
}

static int is_zero(const float *current, uint8_t brake)
{
    size_t i;
    for (i = 0; i < WHEELS; i++) {
        if (current[i] != 0.0f) {
            return 0;
        }
    }
    return brake == 0;
}

static float heat_after(size_t i, float current, float time)
{
    float then = heat[i] + (current * current - limits.continuous_current * limits.continuous_current) * time;
    return then > 0.0f ? then : 0.0f;
}

/* Latch a fault if one more period of these currents would heat a motor beyond its limit. */
static int is_too_hot(const float *current, uint32_t of)
{
    uint8_t i;
    for (i = 0; i < WHEELS; i++) {
        float then = heat_after(i, current[i], seconds(PERIOD_US));
        if (then > limits.heating && magnitude(current[i]) > limits.continuous_current) {
            latch(OMJ_FAULT_HEATING, (uint8_t)(i + 1u), then, limits.heating, of);
            return 1;
        }
    }
    return 0;
}

static void on_command(const omj_command *command, uint32_t of, uint64_t now)
{
    float longest = seconds(now - since > PERIOD_US ? now - since : PERIOD_US);
    uint8_t i;
    if (command->wheels != WHEELS) {
        latch(OMJ_FAULT_MALFORMED, 0, command->wheels, WHEELS, of);
        return;
    }
    if (!armed && !is_zero(command->current, command->brake)) {
        refuse(OMJ_FAULT_NOT_ARMED, 0.0f, 0.0f, of);
        return;
    }
    for (i = 0; i < WHEELS; i++) {
        if (!omj_is_finite(command->current[i])) {
            latch(OMJ_FAULT_NOT_FINITE, (uint8_t)(i + 1u), command->current[i], limits.current, of);
            return;
        }
    }
    if (!omj_is_finite(command->valid_for)) {
        latch(OMJ_FAULT_NOT_FINITE, 0, command->valid_for, limits.valid_for, of);
        return;
    }
    if (!(command->valid_for > 0.0f && command->valid_for <= limits.valid_for)) {
        latch(OMJ_FAULT_VALID_FOR, 0, command->valid_for, limits.valid_for, of);
        return;
    }
    for (i = 0; i < WHEELS; i++) {
        if (magnitude(command->current[i]) > limits.current) {
            latch(OMJ_FAULT_CURRENT, (uint8_t)(i + 1u), command->current[i], limits.current, of);
            return;
        }
    }
    for (i = 0; i < WHEELS; i++) {
        float change = magnitude(command->current[i] - flows[i]);
        if (command->current[i] != 0.0f && change > limits.current_rate * longest) {
            latch(OMJ_FAULT_CURRENT_RATE, (uint8_t)(i + 1u), change, limits.current_rate * longest, of);
            return;
        }
    }
    if (is_too_hot(command->current, of)) {
        return;
    }
    for (i = 0; i < WHEELS; i++) {
        newest[i] = command->current[i];
    }
    newest_brake = command->brake;
    valid_for = command->valid_for;
    arrived = now;
    acknowledged = of;
    has_command = 1;
}

static void on_arm(const omj_frame *frame, uint64_t now)
{
    const omj_arm *arm = &frame->of.arm;
    uint32_t slot = arm->telemetry % 64u;
    if (!frame->same_schema) {
        refuse(OMJ_FAULT_ARM_SCHEMA, 0.0f, 0.0f, frame->sequence);
    } else if (fault) {
        refuse(OMJ_FAULT_ARM_FAULTY, fault, 0.0f, frame->sequence);
    } else if (arm->limits_hash != omj_limits_hash(&limits)) {
        refuse(OMJ_FAULT_ARM_LIMITS, 0.0f, 0.0f, frame->sequence);
    } else if (arm->calibration_hash != calibration_hash) {
        refuse(OMJ_FAULT_ARM_CALIBRATION, 0.0f, 0.0f, frame->sequence);
    } else if (!has_command || !is_zero(newest, newest_brake) || seconds(now - arrived) > valid_for) {
        refuse(OMJ_FAULT_ARM_NOT_ZERO, 0.0f, 0.0f, frame->sequence);
    } else if (arm->telemetry == 0 || told[slot] != arm->telemetry || now - told_at[slot] > 20000u) {
        refuse(OMJ_FAULT_ARM_STALE_TELEMETRY, 0.0f, 0.02f, frame->sequence);
    } else {
        armed = 1;
        since = arrived;
    }
}

static void on_hello(const omj_frame *hello, uint64_t now)
{
    omj_frame answer = {0};
    omj_capabilities *own = &answer.of.capabilities;
    size_t i;
    if (now - hello_at < 1000u) { /* a bucket of one is enough here */
        dropped++;
        return;
    }
    hello_at = now;
    if (armed) {
        refused++;
        say_fault(OMJ_FAULT_BUSY, 0, 0.0f, 0.0f, 0, 0);
        return;
    }
    if (session == 0 || hello->of.nonce != nonce || heard > 0) {
        uint32_t before = session;
        while (session == 0 || session == before) {
            session = board_random();
        }
        nonce = hello->of.nonce;
        heard = said = acknowledged = 0;
        for (i = 0; i < 64u; i++) {
            told[i] = 0;
        }
        disarm();
    }
    answer.type = OMJ_CAPABILITIES;
    answer.session = session;
    answer.sequence = ++said;
    own->nonce = nonce;
    own->limits_hash = omj_limits_hash(&limits);
    own->calibration_hash = calibration_hash;
    own->period_us = PERIOD_US;
    own->limits = limits;
    own->wheels = WHEELS;
    own->channels = CHANNELS;
    for (i = 0; i < CHANNELS; i++) {
        own->channel[i] = channels[i];
    }
    say(&answer);
}

static float most_frames(void)
{
    float most = 0.05f * limits.message_rate;
    return most < 1.0f ? 1.0f : most;
}

static int is_paid_for(uint64_t now)
{
    float most = most_frames();
    bucket += limits.message_rate * seconds(now - bucket_at);
    bucket = bucket > most ? most : bucket;
    bucket_at = now;
    if (bucket < 1.0f) {
        return 0;
    }
    bucket -= 1.0f;
    return 1;
}

static void on_packet(const uint8_t *packet, size_t size)
{
    omj_frame frame;
    uint64_t now = board_now_us();
    if (omj_decode(packet, size, key, &frame) != OMJ_RIGHT) {
        dropped++;
    } else if (frame.type == OMJ_STOP) {
        disarm();
    } else if (frame.type == OMJ_HELLO) {
        on_hello(&frame, now);
    } else if (session == 0 || frame.session != session || frame.sequence <= heard) {
        dropped++;
    } else if (frame.type != OMJ_COMMAND && frame.type != OMJ_ARM && frame.type != OMJ_RESET_FAULT &&
               frame.type != OMJ_PING) {
        dropped++;
    } else {
        heard = frame.sequence;
        if (!is_paid_for(now)) {
            if (fault) {
                refused++;
            } else {
                latch(OMJ_FAULT_MESSAGE_RATE, 0, bucket, limits.message_rate, frame.sequence);
            }
        } else if (frame.type == OMJ_COMMAND) {
            on_command(&frame.of.command, frame.sequence, now);
        } else if (frame.type == OMJ_ARM) {
            on_arm(&frame, now);
        } else if (frame.type == OMJ_RESET_FAULT) {
            fault = OMJ_FAULT_NONE;
        } else {
            omj_frame pong = {0};
            pong.type = OMJ_PONG;
            pong.session = session;
            pong.sequence = ++said;
            pong.of.nonce = frame.of.nonce;
            say(&pong);
        }
    }
}

/* Update the heating of the motors and check the age of the command. */
static void advance(void)
{
    uint64_t now = board_now_us();
    float age = seconds(now - arrived);
    size_t i;
    for (i = 0; i < WHEELS; i++) {
        heat[i] = heat_after(i, flows[i], seconds(now - warmed_at));
    }
    warmed_at = now;
    if (armed && age > valid_for) {
        latch(OMJ_FAULT_COMMAND_TOO_OLD, 0, age, valid_for, 0);
    }
}

static void on_period(uint64_t now)
{
    omj_frame frame = {0};
    omj_telemetry *telemetry = &frame.of.telemetry;
    float speed[WHEELS];
    uint8_t i;
    board_read(telemetry->raw, speed);
    for (i = 0; i < WHEELS && armed; i++) {
        if (!omj_is_finite(speed[i])) {
            latch(OMJ_FAULT_SENSOR, (uint8_t)(i + 1u), speed[i], limits.wheel_speed, 0);
        } else if (magnitude(speed[i]) > limits.wheel_speed) {
            latch(OMJ_FAULT_WHEEL_SPEED, (uint8_t)(i + 1u), speed[i], limits.wheel_speed, 0);
        }
    }
    if (armed && !is_too_hot(newest, 0)) {
        for (i = 0; i < WHEELS; i++) {
            flows[i] = newest[i];
        }
        since = arrived;
        board_amplifiers(flows, newest_brake, 1);
    }
    last_period = now;
    if (session == 0) {
        return;
    }
    frame.type = OMJ_TELEMETRY;
    frame.session = session;
    frame.sequence = ++said;
    telemetry->acknowledged = acknowledged;
    telemetry->command_age_us = acknowledged ? (uint32_t)(now - arrived) : OMJ_NEVER;
    telemetry->status = (uint16_t)((armed ? OMJ_STATUS_ARMED : 0) | (fault ? OMJ_STATUS_FAULT : 0) |
                                   (is_zero(flows, 0) ? 0 : OMJ_STATUS_CURRENT_FLOWS) |
                                   (newest_brake ? OMJ_STATUS_BRAKED : 0) | (key ? OMJ_STATUS_AUTHENTIC : 0));
    telemetry->fault = fault;
    telemetry->channels = CHANNELS;
    telemetry->refused = refused;
    telemetry->dropped = dropped + line.dropped;
    for (i = 0; i < CHANNELS; i++) {
        telemetry->counts |= (uint32_t)(channels[i].raw == OMJ_RAW_COUNTS) << i;
    }
    told[said % 64u] = said;
    told_at[said % 64u] = now;
    say(&frame);
}

void firmware_begin(void)
{
    disarm();
    last_period = warmed_at = bucket_at = board_now_us();
    bucket = most_frames();
}

/* Call repeatedly from the main loop. */
void firmware_turn(void)
{
    uint8_t byte;
    unsigned most = 256; /* noise on the line must not delay what follows */
    while (most-- && board_receive(&byte)) {
        size_t size = omj_stream_take(&line, byte);
        if (size) {
            advance();
            on_packet(line.bytes, size);
        }
    }
    advance();
    if (board_now_us() - last_period >= PERIOD_US) {
        on_period(board_now_us());
    }
}
