/* A complete firmware except for the six functions of the board: the rules of PROTOCOL.md, section 4, in order.
 *
 * For a robot of four wheels on a serial line at 500 Hz. Where frames come as UDP datagrams, hand them to on_packet
 * and leave the stuffing out. There is no lock-step here: that is for emulators.
 */
#include "omnimj_link.h"

#define WHEELS 4u
#define CHANNELS 12u
#define PERIOD_US 2000u
#define SESSION_US 1000000u  /* silence after which a session ends */
#define COOKIE_US 2000000u   /* shortest lifetime of a cookie */
#define ANNOUNCE_US 1000000u /* between two repetitions of CHALLENGE and CAPABILITIES */
#define SETTLING_US 500000u  /* for which a measured current may deviate */
#define TOLD 256u            /* telemetries whose times are kept: longer than the longest valid_for */

uint64_t board_now_us(void);                        /* monotonic */
uint32_t board_random(void);                        /* true random bits */
void board_read(omj_reading *raw, float *speed, float *current); /* all at one instant; rad/s after the gear, A */
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
static const uint64_t identity = 0x0102030405060708u; /* of this device, not 0 */
#ifndef LINK_KEY
#define LINK_KEY NULL /* or 32 random bytes */
#endif
static const uint8_t *const key = LINK_KEY;

static omj_stream line;
static uint32_t session, sessions, heard, said, refused, dropped, acknowledged, latched_at, told[TOLD];
static uint64_t told_at[TOLD], arrived, lives_from, accepted_from, since, last_period, warmed_at, bucket_at, hello_at,
    heard_at, announced_at, deviates_since[WHEELS];
static omj_hello begun_by; /* HELLO of the session */
static uint8_t secret[OMJ_KEY_SIZE], session_key[OMJ_KEY_SIZE];
static float newest[WHEELS], flows[WHEELS], measured[WHEELS], heat[WHEELS], valid_for, bucket;
static uint8_t usable, newest_brake, brake, armed, fault, stopped, has_command;

static float magnitude(float x) { return x < 0.0f ? -x : x; }
static float seconds(uint64_t us) { return (float)us * 1e-6f; }

/* Frames of session 0 have the key of the link, all others that of the session. */
static const uint8_t *key_of(uint32_t number) { return key && number ? session_key : key; }

static void say(omj_frame *frame)
{
    uint8_t packet[OMJ_LONGEST_FRAME], stuffed[OMJ_LONGEST_STUFFED + 1u];
    size_t size;
    frame->time_us = board_now_us();
    size = omj_encode(frame, key_of(frame->session), packet);
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
    armed = has_command = newest_brake = brake = 0;
    for (i = 0; i < WHEELS; i++) {
        newest[i] = flows[i] = 0.0f;
        deviates_since[i] = 0;
    }
    since = board_now_us();
    board_amplifiers(flows, 0, 0);
}

static void latch(uint8_t code, uint8_t wheel, float value, float limit, uint32_t of)
{
    disarm();
    refused += of != 0;
    fault = fault ? fault : code;
    latched_at = said;
    say_fault(code, wheel, value, limit, of, 1);
}

static void refuse(uint8_t code, float value, float limit, uint32_t of)
{
    refused++;
    say_fault(code, 0, value, limit, of, 0);
}

/* When a telemetry was sent; 0 if it is unknown. */
static uint64_t sent_at(uint32_t sequence)
{
    return sequence && told[sequence % TOLD] == sequence ? told_at[sequence % TOLD] : 0u;
}

static int is_zero(const float *current, uint8_t braked)
{
    size_t i;
    for (i = 0; i < WHEELS; i++) {
        if (current[i] != 0.0f) {
            return 0;
        }
    }
    return braked == 0;
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

/* Latch a fault if a command for all wheels violates a limit. */
static int is_beyond(const omj_command *command, uint32_t of, uint64_t now)
{
    float longest = seconds(now - since > PERIOD_US ? now - since : PERIOD_US);
    uint8_t i;
    for (i = 0; i < WHEELS; i++) {
        if (command->current[i] != 0.0f && (command->brake >> i & 1)) {
            latch(OMJ_FAULT_BRAKE_AND_CURRENT, (uint8_t)(i + 1u), command->current[i], 0.0f, of);
            return 1;
        }
    }
    for (i = 0; i < WHEELS; i++) {
        if (!omj_is_finite(command->current[i])) {
            latch(OMJ_FAULT_NOT_FINITE, (uint8_t)(i + 1u), command->current[i], limits.current, of);
            return 1;
        }
    }
    if (!omj_is_finite(command->valid_for)) {
        latch(OMJ_FAULT_NOT_FINITE, 0, command->valid_for, limits.valid_for, of);
        return 1;
    }
    if (!(command->valid_for > 0.0f && command->valid_for <= limits.valid_for)) {
        latch(OMJ_FAULT_VALID_FOR, 0, command->valid_for, limits.valid_for, of);
        return 1;
    }
    for (i = 0; i < WHEELS; i++) {
        if (magnitude(command->current[i]) > limits.current) {
            latch(OMJ_FAULT_CURRENT, (uint8_t)(i + 1u), command->current[i], limits.current, of);
            return 1;
        }
    }
    for (i = 0; i < WHEELS; i++) {
        float change = magnitude(command->current[i] - flows[i]);
        if (command->current[i] != 0.0f && change > limits.current_rate * longest) {
            latch(OMJ_FAULT_CURRENT_RATE, (uint8_t)(i + 1u), change, limits.current_rate * longest, of);
            return 1;
        }
    }
    return is_too_hot(command->current, of);
}

/* A delayed command is as good as a lost one: it is refused and latches nothing. */
static int is_stale(const omj_command *command, uint32_t of, uint64_t now)
{
    uint64_t then = sent_at(command->telemetry);
    int is_allowed = command->valid_for > 0.0f && command->valid_for <= limits.valid_for;
    float age = seconds(now - then), allowed = is_allowed ? command->valid_for : limits.valid_for;
    if (then == 0 || age > allowed) {
        refuse(OMJ_FAULT_STALE, age, allowed, of);
        return 1;
    }
    return 0;
}

static void on_command(const omj_command *command, uint32_t of, uint64_t now)
{
    size_t i;
    if (command->wheels != WHEELS) {
        latch(OMJ_FAULT_MALFORMED, 0, command->wheels, WHEELS, of);
        return;
    }
    if (is_stale(command, of, now)) {
        return;
    }
    if (!armed && !is_zero(command->current, command->brake)) {
        refuse(OMJ_FAULT_NOT_ARMED, 0.0f, 0.0f, of);
        return;
    }
    if (is_beyond(command, of, now)) {
        return;
    }
    for (i = 0; i < WHEELS; i++) {
        newest[i] = command->current[i];
    }
    newest_brake = command->brake;
    valid_for = command->valid_for;
    arrived = now;
    lives_from = accepted_from = sent_at(command->telemetry);
    acknowledged = of;
    has_command = 1;
}

static void on_arm(const omj_frame *frame, uint64_t now)
{
    const omj_arm *arm = &frame->of.arm;
    uint64_t then = sent_at(arm->telemetry);
    if (!frame->same_schema) {
        refuse(OMJ_FAULT_ARM_SCHEMA, 0.0f, 0.0f, frame->sequence);
    } else if (fault) {
        refuse(OMJ_FAULT_ARM_FAULTY, fault, 0.0f, frame->sequence);
    } else if (stopped) {
        refuse(OMJ_FAULT_ARM_STOPPED, 0.0f, 0.0f, frame->sequence);
    } else if (arm->limits_hash != omj_limits_hash(&limits)) {
        refuse(OMJ_FAULT_ARM_LIMITS, 0.0f, 0.0f, frame->sequence);
    } else if (arm->calibration_hash != calibration_hash) {
        refuse(OMJ_FAULT_ARM_CALIBRATION, 0.0f, 0.0f, frame->sequence);
    } else if (!has_command || !is_zero(newest, newest_brake) || seconds(now - lives_from) > valid_for) {
        refuse(OMJ_FAULT_ARM_NOT_ZERO, 0.0f, 0.0f, frame->sequence);
    } else if (then == 0 || now - then > 20000u) {
        refuse(OMJ_FAULT_ARM_STALE_TELEMETRY, 0.0f, 0.02f, frame->sequence);
    } else {
        armed = 1;
        since = arrived;
    }
}

/* A reset is for what the host has seen: it names a telemetry sent since the newest stop and fault. */
static void on_reset(const omj_frame *frame, uint64_t now)
{
    uint64_t then = sent_at(frame->of.seen);
    if (then == 0 || frame->of.seen <= latched_at || seconds(now - then) > limits.valid_for) {
        refuse(OMJ_FAULT_STALE, seconds(now - then), limits.valid_for, frame->sequence);
    } else {
        fault = OMJ_FAULT_NONE;
        stopped = 0;
    }
}

static void begin_session(const omj_hello *hello, uint64_t now)
{
    uint32_t before = session;
    size_t i;
    while (session == 0 || session == before) {
        session = board_random();
    }
    sessions++;
    begun_by = *hello;
    if (key) {
        omj_session_key(session_key, key, hello);
    }
    heard = said = acknowledged = latched_at = 0;
    heard_at = now;
    for (i = 0; i < TOLD; i++) {
        told[i] = 0;
    }
    disarm();
}

static void say_challenge(uint64_t nonce, uint64_t cookie)
{
    omj_frame answer = {0};
    answer.type = OMJ_CHALLENGE;
    answer.of.hello.nonce = nonce;
    answer.of.hello.cookie = cookie;
    answer.of.hello.device = identity;
    say(&answer);
}

static void say_capabilities(void)
{
    omj_frame answer = {0};
    omj_capabilities *own = &answer.of.capabilities;
    size_t i;
    answer.type = OMJ_CAPABILITIES;
    answer.session = session;
    answer.sequence = ++said;
    own->nonce = begun_by.nonce;
    own->limits_hash = omj_limits_hash(&limits);
    own->calibration_hash = calibration_hash;
    own->period_us = PERIOD_US;
    own->limits = limits;
    own->wheels = WHEELS;
    own->channels = CHANNELS;
    for (i = 0; i < CHANNELS; i++) {
        own->channel[i] = channels[i];
    }
    announced_at = board_now_us();
    say(&answer);
}

/* On a serial line there is one sender; on UDP its address is an input of the cookie, and frames of the session are
 * accepted from the address that began it only. */
static void on_hello(const omj_hello *hello, uint64_t now)
{
    uint64_t era = now / COOKIE_US + 1u;
    uint64_t cookie = omj_cookie(secret, hello->nonce, sessions, era, NULL, 0);
    uint64_t earlier = omj_cookie(secret, hello->nonce, sessions, era - 1u, NULL, 0);
    int repeated = session && heard == 0 && hello->nonce == begun_by.nonce && hello->cookie == begun_by.cookie &&
                   hello->device == begun_by.device;
    if (now - hello_at < 500u) { /* a bucket of one is enough here */
        dropped++;
        return;
    }
    hello_at = now;
    if (!repeated && (hello->device != identity || (hello->cookie != cookie && hello->cookie != earlier))) {
        say_challenge(hello->nonce, cookie); /* nothing is kept for a sender that has not returned a cookie */
    } else if (armed) {
        refused++;
        say_fault(OMJ_FAULT_BUSY, 0, 0.0f, 0.0f, (uint32_t)hello->nonce, 0);
    } else {
        if (!repeated) {
            begin_session(hello, now);
        }
        say_capabilities();
    }
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
    uint32_t number = size >= 8u ? (uint32_t)omj_get(packet + 4, 4) : 0u;
    if (omj_decode(packet, size, key_of(number), &frame) != OMJ_RIGHT) {
        dropped++;
    } else if (frame.type == OMJ_STOP) {
        disarm();
        stopped = 1;
        latched_at = said;
    } else if (frame.type == OMJ_HELLO) {
        on_hello(&frame.of.hello, now);
    } else if (session == 0 || frame.session != session || frame.sequence <= heard) {
        dropped++;
    } else if (frame.type != OMJ_COMMAND && frame.type != OMJ_ARM && frame.type != OMJ_RESET &&
               frame.type != OMJ_PING) {
        dropped++;
    } else {
        heard = frame.sequence;
        heard_at = now;
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
        } else if (frame.type == OMJ_RESET) {
            on_reset(&frame, now);
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

/* Update the heating of the motors, check the age of the command, and end a silent session. */
static void advance(void)
{
    uint64_t now = board_now_us();
    float age = seconds(now - lives_from);
    size_t i;
    for (i = 0; i < WHEELS; i++) {
        int is_larger = omj_is_finite(measured[i]) && magnitude(measured[i]) > magnitude(flows[i]);
        heat[i] = heat_after(i, is_larger ? measured[i] : flows[i], seconds(now - warmed_at));
    }
    warmed_at = now;
    if (armed && age > valid_for) {
        latch(OMJ_FAULT_COMMAND_TOO_OLD, 0, age, valid_for, 0);
    }
    if (session && now - heard_at > SESSION_US) {
        session = 0;
        disarm();
    }
}

/* Latch a fault if a measured current has not followed its set value for too long; a third of the limit is allowed. */
static void compare_currents(uint64_t now)
{
    uint8_t i;
    for (i = 0; i < WHEELS && armed; i++) {
        int follows = (brake >> i & 1) || magnitude(measured[i] - flows[i]) <= limits.current / 3.0f;
        if (follows) {
            deviates_since[i] = 0;
        } else if (deviates_since[i] == 0) {
            deviates_since[i] = now;
        } else if (now - deviates_since[i] > SETTLING_US) {
            latch(OMJ_FAULT_CURRENT_DEVIATION, (uint8_t)(i + 1u), seconds(now - deviates_since[i]),
                  seconds(SETTLING_US), 0);
        }
    }
}

static void on_period(uint64_t now)
{
    omj_frame frame = {0};
    omj_telemetry *telemetry = &frame.of.telemetry;
    float speed[WHEELS];
    uint8_t i;
    board_read(telemetry->raw, speed, measured);
    for (i = 0; i < WHEELS && armed; i++) {
        if (!omj_is_finite(speed[i])) {
            latch(OMJ_FAULT_SENSOR, (uint8_t)(i + 1u), speed[i], limits.wheel_speed, 0);
        } else if (magnitude(speed[i]) > limits.wheel_speed) {
            latch(OMJ_FAULT_WHEEL_SPEED, (uint8_t)(i + 1u), speed[i], limits.wheel_speed, 0);
        }
    }
    compare_currents(now);
    if (armed && !is_too_hot(newest, 0)) {
        for (i = 0; i < WHEELS; i++) {
            flows[i] = newest[i];
        }
        since = arrived;
        brake = newest_brake;
        board_amplifiers(flows, newest_brake, 1);
    }
    last_period = now;
    if (session == 0 || heard == 0) { /* a session is silent until its host has spoken */
        return;
    }
    frame.type = OMJ_TELEMETRY;
    frame.session = session;
    frame.sequence = ++said;
    telemetry->acknowledged = acknowledged;
    telemetry->command_age_us = acknowledged ? (uint32_t)(now - accepted_from) : OMJ_NEVER;
    telemetry->status = (uint16_t)((armed ? OMJ_STATUS_ARMED : 0) | (fault ? OMJ_STATUS_FAULT : 0) |
                                   (is_zero(flows, 0) ? 0 : OMJ_STATUS_CURRENT_FLOWS) |
                                   (brake ? OMJ_STATUS_BRAKED : 0) | (key ? OMJ_STATUS_AUTHENTIC : 0) |
                                   (stopped ? OMJ_STATUS_STOPPED : 0));
    telemetry->fault = fault;
    telemetry->channels = CHANNELS;
    telemetry->refused = refused;
    telemetry->dropped = dropped + line.dropped;
    for (i = 0; i < CHANNELS; i++) {
        telemetry->counts |= (uint32_t)(channels[i].raw == OMJ_RAW_COUNTS) << i;
    }
    told[said % TOLD] = said;
    told_at[said % TOLD] = now;
    say(&frame);
    if (now - announced_at >= ANNOUNCE_US) { /* for passive listeners, which may have come late */
        say_challenge(begun_by.nonce, begun_by.cookie);
        say_capabilities();
    }
}

void firmware_begin(void)
{
    size_t i;
    for (i = 0; i < sizeof secret; i++) {
        secret[i] = (uint8_t)board_random();
    }
    disarm();
    last_period = warmed_at = bucket_at = board_now_us();
    bucket = most_frames();
    usable = !key || !omj_is_weak_key(key);
}

/* Call repeatedly from the main loop. */
void firmware_turn(void)
{
    uint8_t byte;
    unsigned most = usable ? 256 : 0; /* noise on the line must not delay what follows */
    while (most && board_receive(&byte)) {
        most--;
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
