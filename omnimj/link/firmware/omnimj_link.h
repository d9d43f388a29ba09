/* The link between host and device, for firmware: frames, COBS, CRC-32, BLAKE2s. PROTOCOL.md describes it.
 *
 * C99, freestanding, one header, no memory of its own: include it wherever it is needed. Numbers are as on the
 * wire (names with _us are microseconds), `float` must be IEEE 754 single. Functions change
 * nothing but their arguments.
 */
#ifndef OMNIMJ_LINK_H
#define OMNIMJ_LINK_H

#include <stddef.h>
#include <stdint.h>

#define OMJ_PROTOCOL 2u
#define OMJ_SCHEMA 0x3ACCF070u
#define OMJ_LONGEST_FRAME 512u
#define OMJ_LONGEST_STUFFED (OMJ_LONGEST_FRAME + OMJ_LONGEST_FRAME / 254u + 1u)
#define OMJ_MOST_WHEELS 8u
#define OMJ_MOST_CHANNELS 32u
#define OMJ_HEADER_SIZE 24u
#define OMJ_CHECKSUM_SIZE 4u
#define OMJ_TAG_SIZE 16u
#define OMJ_KEY_SIZE 32u
#define OMJ_TAGGED 1u
/* command_age_us of a device that has no command */
#define OMJ_NEVER 0xFFFFFFFFu

enum omj_type {
    OMJ_HELLO = 1,
    OMJ_CAPABILITIES = 2,
    OMJ_ARM = 3,
    OMJ_COMMAND = 4,
    OMJ_TELEMETRY = 5,
    OMJ_STOP = 6,
    OMJ_FAULT = 7,
    OMJ_RESET = 8,
    OMJ_PING = 9,
    OMJ_PONG = 10,
    OMJ_CHALLENGE = 11
};

enum omj_quantity {
    OMJ_QUANTITY_CURRENT = 0,
    OMJ_QUANTITY_WHEEL_SPEED = 1,
    OMJ_QUANTITY_WHEEL_ANGLE = 2,
    OMJ_QUANTITY_ACCELERATION_X = 3,
    OMJ_QUANTITY_ACCELERATION_Y = 4,
    OMJ_QUANTITY_YAW_RATE = 5,
    OMJ_QUANTITY_YAW = 6,
    OMJ_QUANTITY_SUPPLY = 7,
    OMJ_QUANTITY_OTHER = 8
};
#define OMJ_QUANTITIES 9u

enum omj_raw { OMJ_RAW_VOLTS = 0, OMJ_RAW_COUNTS = 1 };
#define OMJ_RAWS 2u

enum omj_status {
    OMJ_STATUS_ARMED = 1,
    OMJ_STATUS_FAULT = 2,
    OMJ_STATUS_LOCK_STEP = 4,
    OMJ_STATUS_CURRENT_FLOWS = 8,
    OMJ_STATUS_BRAKED = 16,
    OMJ_STATUS_AUTHENTIC = 32,
    OMJ_STATUS_STOPPED = 64
};
#define OMJ_STATUSES 128u

enum omj_fault_code {
    OMJ_FAULT_NONE = 0,
    OMJ_FAULT_COMMAND_TOO_OLD = 1,
    OMJ_FAULT_NOT_FINITE = 2,
    OMJ_FAULT_CURRENT = 3,
    OMJ_FAULT_CURRENT_RATE = 4,
    OMJ_FAULT_HEATING = 5,
    OMJ_FAULT_WHEEL_SPEED = 6,
    OMJ_FAULT_MESSAGE_RATE = 7,
    OMJ_FAULT_VALID_FOR = 8,
    OMJ_FAULT_NOT_ARMED = 9,
    OMJ_FAULT_ARM_NOT_ZERO = 10,
    OMJ_FAULT_ARM_STALE_TELEMETRY = 11,
    OMJ_FAULT_ARM_SCHEMA = 12,
    OMJ_FAULT_ARM_LIMITS = 13,
    OMJ_FAULT_ARM_CALIBRATION = 14,
    OMJ_FAULT_ARM_FAULTY = 15,
    OMJ_FAULT_MALFORMED = 16,
    OMJ_FAULT_SENSOR = 17,
    OMJ_FAULT_BUSY = 18,
    OMJ_FAULT_STALE = 19,
    OMJ_FAULT_ARM_STOPPED = 20,
    OMJ_FAULT_BRAKE_AND_CURRENT = 21,
    OMJ_FAULT_CURRENT_DEVIATION = 22
};
#define OMJ_FAULT_CODES 23u

/* Reason to drop a packet, in the order of the checks. */
enum omj_drop {
    OMJ_RIGHT = 0,
    OMJ_TOO_SHORT = 1,
    OMJ_TOO_LONG = 2,
    OMJ_STUFFING = 3,
    OMJ_CHECKSUM = 4,
    OMJ_WRONG_PROTOCOL = 5,
    OMJ_WRONG_TYPE = 6,
    OMJ_WRONG_FLAGS = 7,
    OMJ_LENGTH = 8,
    OMJ_NO_KEY = 9,
    OMJ_NO_TAG = 10,
    OMJ_WRONG_TAG = 11,
    OMJ_WRONG_SCHEMA = 12,
    OMJ_VALUE = 13
};

typedef struct {
    uint8_t quantity, wheel, raw;
} omj_channel;

typedef struct {
    float current, current_rate, continuous_current, heating, wheel_speed, message_rate, valid_for;
} omj_limits;

typedef struct {
    uint64_t nonce, limits_hash, calibration_hash;
    uint32_t period_us;
    omj_limits limits;
    uint8_t lock_step, wheels, channels;
    omj_channel channel[OMJ_MOST_CHANNELS];
} omj_capabilities;

typedef struct {
    uint64_t nonce, cookie, device;
} omj_hello;

typedef struct {
    uint64_t limits_hash, calibration_hash;
    uint32_t telemetry;
} omj_arm;

typedef struct {
    float valid_for;
    uint8_t wheels, brake;
    uint32_t telemetry; /* that it answers */
    float current[OMJ_MOST_WHEELS];
} omj_command;

typedef union {
    float volts;
    int32_t counts;
    uint32_t bits;
} omj_reading;

typedef struct {
    uint32_t acknowledged, command_age_us;
    uint16_t status;
    uint8_t fault, channels;
    uint32_t refused, dropped, counts;
    omj_reading raw[OMJ_MOST_CHANNELS];
} omj_telemetry;

typedef struct {
    uint8_t code, wheel, latched;
    float value, limit;
    uint32_t sequence;
} omj_fault;

typedef struct {
    uint8_t type;
    uint8_t authentic;   /* decoded with a key and a valid tag */
    uint8_t same_schema; /* its sender has the same payload layouts */
    uint32_t session, sequence;
    uint64_t time_us;
    union {
        uint64_t nonce;     /* of ping, pong */
        uint32_t seen;      /* telemetry that a reset names */
        omj_hello hello;    /* of hello, challenge */
        omj_capabilities capabilities;
        omj_arm arm;
        omj_command command;
        omj_telemetry telemetry;
        omj_fault fault;
    } of;
} omj_frame;

/* ---- numbers, little endian ------------------------------------------------------------------------------ */

static inline void omj_put(uint8_t *to, uint64_t value, size_t bytes)
{
    size_t i;
    for (i = 0; i < bytes; i++) {
        to[i] = (uint8_t)(value >> (8u * i));
    }
}

static inline uint64_t omj_get(const uint8_t *from, size_t bytes)
{
    uint64_t value = 0;
    size_t i;
    for (i = 0; i < bytes; i++) {
        value |= (uint64_t)from[i] << (8u * i);
    }
    return value;
}

static inline void omj_put_float(uint8_t *to, float value)
{
    omj_reading number;
    number.volts = value;
    omj_put(to, number.bits, 4);
}

static inline float omj_get_float(const uint8_t *from)
{
    omj_reading number;
    number.bits = (uint32_t)omj_get(from, 4);
    return number.volts;
}

/* Finite and above zero, also under compilers that assume finite arithmetic. */
static inline int omj_is_above_zero(float value)
{
    omj_reading number;
    number.volts = value;
    return number.bits > 0 && number.bits < 0x7F800000u;
}

static inline int omj_is_finite(float value)
{
    omj_reading number;
    number.volts = value;
    return (number.bits & 0x7F800000u) != 0x7F800000u;
}

/* ---- CRC-32 of zlib, PNG and Ethernet: polynomial 0xEDB88320, initial value and final XOR all ones ------------ */

static inline uint32_t omj_crc32(const uint8_t *bytes, size_t size)
{
    static const uint32_t nibble[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu};
    uint32_t crc = 0xFFFFFFFFu;
    size_t i;
    for (i = 0; i < size; i++) {
        crc ^= bytes[i];
        crc = (crc >> 4) ^ nibble[crc & 15u];
        crc = (crc >> 4) ^ nibble[crc & 15u];
    }
    return ~crc;
}

/* ---- BLAKE2s (RFC 7693) ---------------------------------------------------------------------------------- */

static inline uint32_t omj_turn(uint32_t word, unsigned by)
{
    return (word >> by) | (word << (32u - by));
}

static inline void omj_blake2s_mix(uint32_t *v, int a, int b, int c, int d, uint32_t x, uint32_t y)
{
    v[a] += v[b] + x;
    v[d] = omj_turn(v[d] ^ v[a], 16);
    v[c] += v[d];
    v[b] = omj_turn(v[b] ^ v[c], 12);
    v[a] += v[b] + y;
    v[d] = omj_turn(v[d] ^ v[a], 8);
    v[c] += v[d];
    v[b] = omj_turn(v[b] ^ v[c], 7);
}

static const uint32_t omj_blake2s_start[8] = {0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au,
                                              0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u};

static inline void omj_blake2s_block(uint32_t *h, const uint8_t *block, uint64_t count, int last)
{
    static const uint8_t order[10][16] = {
        {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
        {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
        {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
        {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
        {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
        {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
        {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
        {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
        {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
        {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};
    uint32_t v[16], m[16];
    int i;
    for (i = 0; i < 16; i++) {
        m[i] = (uint32_t)omj_get(block + 4 * i, 4);
        v[i] = i < 8 ? h[i] : omj_blake2s_start[i - 8];
    }
    v[12] ^= (uint32_t)count;
    v[13] ^= (uint32_t)(count >> 32);
    v[14] ^= last ? 0xFFFFFFFFu : 0u;
    for (i = 0; i < 10; i++) {
        const uint8_t *s = order[i];
        omj_blake2s_mix(v, 0, 4, 8, 12, m[s[0]], m[s[1]]);
        omj_blake2s_mix(v, 1, 5, 9, 13, m[s[2]], m[s[3]]);
        omj_blake2s_mix(v, 2, 6, 10, 14, m[s[4]], m[s[5]]);
        omj_blake2s_mix(v, 3, 7, 11, 15, m[s[6]], m[s[7]]);
        omj_blake2s_mix(v, 0, 5, 10, 15, m[s[8]], m[s[9]]);
        omj_blake2s_mix(v, 1, 6, 11, 12, m[s[10]], m[s[11]]);
        omj_blake2s_mix(v, 2, 7, 8, 13, m[s[12]], m[s[13]]);
        omj_blake2s_mix(v, 3, 4, 9, 14, m[s[14]], m[s[15]]);
    }
    for (i = 0; i < 8; i++) {
        h[i] ^= v[i] ^ v[i + 8];
    }
}

/* Digest of `length` (1-32) bytes; the key has key_size (0-32) bytes and may be NULL if that is 0. */
static inline void omj_blake2s(uint8_t *digest, size_t length, const uint8_t *key, size_t key_size,
                               const uint8_t *bytes, size_t size)
{
    uint32_t h[8];
    uint8_t block[64];
    uint64_t count = 0;
    size_t i, at = 0;
    int key_comes = key_size > 0;
    for (i = 0; i < 8; i++) {
        h[i] = omj_blake2s_start[i];
    }
    h[0] ^= 0x01010000u ^ ((uint32_t)key_size << 8) ^ (uint32_t)length;
    do { /* the key is a block of its own before the bytes; no key and no bytes are one block of zeros */
        size_t now = key_comes ? 64u : (size - at < 64u ? size - at : 64u);
        for (i = 0; i < 64u; i++) {
            block[i] = (uint8_t)(key_comes ? (i < key_size ? key[i] : 0u) : (i < now ? bytes[at + i] : 0u));
        }
        count += now;
        at += key_comes ? 0u : now;
        key_comes = 0;
        omj_blake2s_block(h, block, count, at == size);
    } while (at < size);
    for (i = 0; i < length; i++) {
        digest[i] = (uint8_t)(h[i / 4] >> (8u * (i % 4)));
    }
}

/* First 8 bytes of BLAKE2s-256, little endian: of limits and of calibration. */
static inline uint64_t omj_short_hash(const uint8_t *bytes, size_t size)
{
    uint8_t digest[32];
    omj_blake2s(digest, 32, NULL, 0, bytes, size);
    return omj_get(digest, 8);
}

/* Key of a session, 32 bytes, from the key of the link and the HELLO that began it. */
static inline void omj_session_key(uint8_t *to, const uint8_t *key, const omj_hello *hello)
{
    static const char label[17] = "omnimj session 2";
    uint8_t content[40];
    size_t i;
    for (i = 0; i < 16u; i++) {
        content[i] = (uint8_t)label[i];
    }
    omj_put(content + 16, hello->device, 8);
    omj_put(content + 24, hello->nonce, 8);
    omj_put(content + 32, hello->cookie, 8);
    omj_blake2s(to, OMJ_KEY_SIZE, key, OMJ_KEY_SIZE, content, sizeof content);
}

/* Cookie for the sender of a HELLO, never 0. The secret has 32 random bytes drawn at power-up, `sessions` counts the
 * sessions so far, `era` is a coarse time; the sender's address has at most 44 bytes, none on a serial line. */
static inline uint64_t omj_cookie(const uint8_t *secret, uint64_t nonce, uint32_t sessions, uint64_t era,
                                  const uint8_t *address, size_t address_size)
{
    uint8_t content[64], digest[8];
    uint64_t cookie;
    size_t i, size = 20;
    omj_put(content, nonce, 8);
    omj_put(content + 8, sessions, 4);
    omj_put(content + 12, era, 8);
    for (i = 0; i < address_size && size < sizeof content; i++) {
        content[size++] = address[i];
    }
    omj_blake2s(digest, 8, secret, OMJ_KEY_SIZE, content, size);
    cookie = omj_get(digest, 8);
    return cookie ? cookie : 1u;
}

/* Fewer than 16 distinct bytes, or distinct differences of neighbours: no random key, which must not be used. */
static inline int omj_is_weak_key(const uint8_t *key)
{
    size_t i, k, bytes = 0, steps = 0;
    for (i = 0; i < OMJ_KEY_SIZE; i++) {
        int new_byte = 1, new_step = i > 0;
        for (k = 0; k < i; k++) {
            new_byte &= key[k] != key[i];
            new_step &= k == 0 || (uint8_t)(key[k] - key[k - 1]) != (uint8_t)(key[i] - key[i - 1]);
        }
        bytes += (size_t)new_byte;
        steps += (size_t)new_step;
    }
    return bytes < 16u || steps < 16u;
}

static inline void omj_put_limits(uint8_t *to, const omj_limits *limits)
{
    omj_put_float(to, limits->current);
    omj_put_float(to + 4, limits->current_rate);
    omj_put_float(to + 8, limits->continuous_current);
    omj_put_float(to + 12, limits->heating);
    omj_put_float(to + 16, limits->wheel_speed);
    omj_put_float(to + 20, limits->message_rate);
    omj_put_float(to + 24, limits->valid_for);
}

static inline uint64_t omj_limits_hash(const omj_limits *limits)
{
    uint8_t bytes[28];
    omj_put_limits(bytes, limits);
    return omj_short_hash(bytes, sizeof bytes);
}

/* ---- COBS ------------------------------------------------------------------------------------------------ */

/* Stuffs a packet and ends it with a zero; `to` has room for size + size / 254 + 2 bytes. Returns their number. */
static inline size_t omj_cobs_encode(const uint8_t *packet, size_t size, uint8_t *to)
{
    size_t code = 0, at = 1, i;
    for (i = 0; i < size; i++) {
        if (packet[i] != 0) {
            to[at++] = packet[i];
        }
        if (packet[i] == 0 || (at - code == 255u && i + 1 < size)) {
            to[code] = (uint8_t)(at - code);
            code = at++;
        }
    }
    to[code] = (uint8_t)(at - code);
    to[at++] = 0;
    return at;
}

/* Unstuffs the bytes before a zero; `to` may be `stuffed` itself. Returns the size, 0 if they are no packet. */
static inline size_t omj_cobs_decode(const uint8_t *stuffed, size_t size, uint8_t *to)
{
    size_t i = 0, at = 0, k;
    while (i < size) {
        uint8_t code = stuffed[i];
        if (code == 0 || i + code > size) {
            return 0;
        }
        for (k = i + 1; k < i + code; k++) {
            if (stuffed[k] == 0) {
                return 0;
            }
            to[at++] = stuffed[k];
        }
        i += code;
        if (code < 255u && i < size) {
            to[at++] = 0;
        }
    }
    return at;
}

/* State of a serial line, read byte by byte. Initialise with zeros. */
typedef struct {
    uint8_t bytes[OMJ_LONGEST_STUFFED];
    size_t size;
    uint8_t lost;     /* piece is too long: wait for the next zero */
    uint32_t dropped; /* pieces that are no packet */
} omj_stream;

/* Takes one byte. Returns the size of a packet, which is in stream->bytes until the next call, or 0. */
static inline size_t omj_stream_take(omj_stream *stream, uint8_t byte)
{
    size_t size = stream->size;
    if (byte != 0) {
        if (size < OMJ_LONGEST_STUFFED) {
            stream->bytes[stream->size++] = byte;
        } else {
            stream->lost = 1;
        }
        return 0;
    }
    stream->size = 0;
    if (size == 0) {
        return 0;
    }
    size = stream->lost ? 0 : omj_cobs_decode(stream->bytes, size, stream->bytes);
    stream->lost = 0;
    if (size < OMJ_HEADER_SIZE + OMJ_CHECKSUM_SIZE) {
        stream->dropped++;
        return 0;
    }
    return size;
}

/* ---- frames ---------------------------------------------------------------------------------------------- */

static inline size_t omj_put_capabilities(uint8_t *to, const omj_capabilities *from)
{
    size_t i;
    omj_put(to, from->nonce, 8);
    omj_put(to + 8, from->limits_hash, 8);
    omj_put(to + 16, from->calibration_hash, 8);
    omj_put(to + 24, from->period_us, 4);
    omj_put_limits(to + 28, &from->limits);
    to[56] = from->lock_step;
    to[57] = from->wheels;
    to[58] = from->channels;
    to[59] = 0;
    for (i = 0; i < from->channels; i++) {
        to[60 + 4 * i] = from->channel[i].quantity;
        to[61 + 4 * i] = from->channel[i].wheel;
        to[62 + 4 * i] = from->channel[i].raw;
        to[63 + 4 * i] = 0;
    }
    return 60u + 4u * from->channels;
}

static inline size_t omj_put_command(uint8_t *to, const omj_command *from)
{
    size_t i;
    omj_put_float(to, from->valid_for);
    to[4] = from->wheels;
    to[5] = from->brake;
    omj_put(to + 6, 0, 2);
    omj_put(to + 8, from->telemetry, 4);
    for (i = 0; i < from->wheels; i++) {
        omj_put_float(to + 12 + 4 * i, from->current[i]);
    }
    return 12u + 4u * from->wheels;
}

static inline size_t omj_put_telemetry(uint8_t *to, const omj_telemetry *from)
{
    size_t i;
    omj_put(to, from->acknowledged, 4);
    omj_put(to + 4, from->command_age_us, 4);
    omj_put(to + 8, from->status, 2);
    to[10] = from->fault;
    to[11] = from->channels;
    omj_put(to + 12, from->refused, 4);
    omj_put(to + 16, from->dropped, 4);
    omj_put(to + 20, from->counts, 4);
    for (i = 0; i < from->channels; i++) {
        omj_put(to + 24 + 4 * i, from->raw[i].bits, 4);
    }
    return 24u + 4u * from->channels;
}

static inline size_t omj_put_fault(uint8_t *to, const omj_fault *from)
{
    to[0] = from->code;
    to[1] = from->wheel;
    to[2] = from->latched;
    to[3] = 0;
    omj_put_float(to + 4, from->value);
    omj_put_float(to + 8, from->limit);
    omj_put(to + 12, from->sequence, 4);
    return 16;
}

/* Writes a frame to OMJ_LONGEST_FRAME bytes; with a key (32 bytes) it gets a tag. Returns the size, 0 if there
 * are more wheels or channels than a frame holds. */
static inline size_t omj_encode(const omj_frame *frame, const uint8_t *key, uint8_t *to)
{
    size_t size = OMJ_HEADER_SIZE;
    to[0] = OMJ_PROTOCOL;
    to[1] = frame->type;
    omj_put(to + 2, key ? OMJ_TAGGED : 0u, 2);
    omj_put(to + 4, frame->session, 4);
    omj_put(to + 8, frame->sequence, 4);
    omj_put(to + 12, frame->time_us, 8);
    omj_put(to + 20, OMJ_SCHEMA, 4);
    switch (frame->type) {
    case OMJ_HELLO:
    case OMJ_CHALLENGE:
        omj_put(to + size, frame->of.hello.nonce, 8);
        omj_put(to + size + 8, frame->of.hello.cookie, 8);
        omj_put(to + size + 16, frame->of.hello.device, 8);
        size += 24;
        break;
    case OMJ_PING:
    case OMJ_PONG:
        omj_put(to + size, frame->of.nonce, 8);
        size += 8;
        break;
    case OMJ_RESET:
        omj_put(to + size, frame->of.seen, 4);
        size += 4;
        break;
    case OMJ_CAPABILITIES:
        if (frame->of.capabilities.channels > OMJ_MOST_CHANNELS) {
            return 0;
        }
        size += omj_put_capabilities(to + size, &frame->of.capabilities);
        break;
    case OMJ_ARM:
        omj_put(to + size, frame->of.arm.limits_hash, 8);
        omj_put(to + size + 8, frame->of.arm.calibration_hash, 8);
        omj_put(to + size + 16, frame->of.arm.telemetry, 4);
        size += 20;
        break;
    case OMJ_COMMAND:
        if (frame->of.command.wheels > OMJ_MOST_WHEELS) {
            return 0;
        }
        size += omj_put_command(to + size, &frame->of.command);
        break;
    case OMJ_TELEMETRY:
        if (frame->of.telemetry.channels > OMJ_MOST_CHANNELS) {
            return 0;
        }
        size += omj_put_telemetry(to + size, &frame->of.telemetry);
        break;
    case OMJ_FAULT:
        size += omj_put_fault(to + size, &frame->of.fault);
        break;
    case OMJ_STOP:
        break;
    default:
        return 0;
    }
    if (key) {
        omj_blake2s(to + size, OMJ_TAG_SIZE, key, OMJ_KEY_SIZE, to, size);
        size += OMJ_TAG_SIZE;
    }
    omj_put(to + size, omj_crc32(to, size), 4);
    return size + OMJ_CHECKSUM_SIZE;
}

static inline enum omj_drop omj_get_capabilities(const uint8_t *from, size_t size, omj_capabilities *to)
{
    size_t i;
    int right;
    if (size < 60u || size != 60u + 4u * from[58]) {
        return OMJ_LENGTH;
    }
    to->nonce = omj_get(from, 8);
    to->limits_hash = omj_get(from + 8, 8);
    to->calibration_hash = omj_get(from + 16, 8);
    to->period_us = (uint32_t)omj_get(from + 24, 4);
    to->limits.current = omj_get_float(from + 28);
    to->limits.current_rate = omj_get_float(from + 32);
    to->limits.continuous_current = omj_get_float(from + 36);
    to->limits.heating = omj_get_float(from + 40);
    to->limits.wheel_speed = omj_get_float(from + 44);
    to->limits.message_rate = omj_get_float(from + 48);
    to->limits.valid_for = omj_get_float(from + 52);
    to->lock_step = from[56];
    to->wheels = from[57];
    to->channels = from[58];
    right = from[59] == 0 && to->lock_step <= 1 && to->wheels >= 1 && to->wheels <= OMJ_MOST_WHEELS &&
            to->channels <= OMJ_MOST_CHANNELS && to->period_us > 0;
    for (i = 0; right && i < 7u; i++) {
        right = omj_is_above_zero(omj_get_float(from + 28 + 4 * i));
    }
    for (i = 0; right && i < to->channels; i++) {
        const uint8_t *channel = from + 60 + 4 * i;
        to->channel[i].quantity = channel[0];
        to->channel[i].wheel = channel[1];
        to->channel[i].raw = channel[2];
        right = channel[0] < OMJ_QUANTITIES && channel[1] <= to->wheels && channel[2] < OMJ_RAWS && channel[3] == 0;
    }
    return right ? OMJ_RIGHT : OMJ_VALUE;
}

static inline enum omj_drop omj_get_command(const uint8_t *from, size_t size, omj_command *to)
{
    size_t i;
    if (size < 12u || size != 12u + 4u * from[4]) {
        return OMJ_LENGTH;
    }
    to->valid_for = omj_get_float(from);
    to->wheels = from[4];
    to->brake = from[5];
    if (omj_get(from + 6, 2) != 0 || to->wheels < 1 || to->wheels > OMJ_MOST_WHEELS ||
        ((unsigned)to->brake >> to->wheels) != 0) {
        return OMJ_VALUE;
    }
    to->telemetry = (uint32_t)omj_get(from + 8, 4);
    for (i = 0; i < to->wheels; i++) {
        to->current[i] = omj_get_float(from + 12 + 4 * i);
    }
    return OMJ_RIGHT;
}

static inline enum omj_drop omj_get_telemetry(const uint8_t *from, size_t size, omj_telemetry *to)
{
    size_t i;
    if (size < 24u || size != 24u + 4u * from[11]) {
        return OMJ_LENGTH;
    }
    to->acknowledged = (uint32_t)omj_get(from, 4);
    to->command_age_us = (uint32_t)omj_get(from + 4, 4);
    to->status = (uint16_t)omj_get(from + 8, 2);
    to->fault = from[10];
    to->channels = from[11];
    to->refused = (uint32_t)omj_get(from + 12, 4);
    to->dropped = (uint32_t)omj_get(from + 16, 4);
    to->counts = (uint32_t)omj_get(from + 20, 4);
    if (to->fault >= OMJ_FAULT_CODES || to->channels > OMJ_MOST_CHANNELS || to->status >= OMJ_STATUSES ||
        ((uint64_t)to->counts >> to->channels) != 0) {
        return OMJ_VALUE;
    }
    for (i = 0; i < to->channels; i++) {
        to->raw[i].bits = (uint32_t)omj_get(from + 24 + 4 * i, 4);
    }
    return OMJ_RIGHT;
}

static inline enum omj_drop omj_get_fault(const uint8_t *from, size_t size, omj_fault *to)
{
    if (size != 16u) {
        return OMJ_LENGTH;
    }
    to->code = from[0];
    to->wheel = from[1];
    to->latched = from[2];
    to->value = omj_get_float(from + 4);
    to->limit = omj_get_float(from + 8);
    to->sequence = (uint32_t)omj_get(from + 12, 4);
    return from[0] < OMJ_FAULT_CODES && from[1] <= OMJ_MOST_WHEELS && from[2] <= 1 && from[3] == 0 ? OMJ_RIGHT
                                                                                                   : OMJ_VALUE;
}

static inline enum omj_drop omj_get_payload(const uint8_t *from, size_t size, omj_frame *to)
{
    switch (to->type) {
    case OMJ_HELLO:
    case OMJ_CHALLENGE:
        if (size != 24u) {
            return OMJ_LENGTH;
        }
        to->of.hello.nonce = omj_get(from, 8);
        to->of.hello.cookie = omj_get(from + 8, 8);
        to->of.hello.device = omj_get(from + 16, 8);
        return to->type == OMJ_HELLO || (to->of.hello.cookie && to->of.hello.device) ? OMJ_RIGHT : OMJ_VALUE;
    case OMJ_PING:
    case OMJ_PONG:
        if (size != 8u) {
            return OMJ_LENGTH;
        }
        to->of.nonce = omj_get(from, 8);
        return OMJ_RIGHT;
    case OMJ_CAPABILITIES:
        return omj_get_capabilities(from, size, &to->of.capabilities);
    case OMJ_ARM:
        if (size != 20u) {
            return OMJ_LENGTH;
        }
        to->of.arm.limits_hash = omj_get(from, 8);
        to->of.arm.calibration_hash = omj_get(from + 8, 8);
        to->of.arm.telemetry = (uint32_t)omj_get(from + 16, 4);
        return OMJ_RIGHT;
    case OMJ_COMMAND:
        return omj_get_command(from, size, &to->of.command);
    case OMJ_TELEMETRY:
        return omj_get_telemetry(from, size, &to->of.telemetry);
    case OMJ_FAULT:
        return omj_get_fault(from, size, &to->of.fault);
    case OMJ_RESET:
        if (size != 4u) {
            return OMJ_LENGTH;
        }
        to->of.seen = (uint32_t)omj_get(from, 4);
        return OMJ_RIGHT;
    default: /* stop */
        return size == 0 ? OMJ_RIGHT : OMJ_LENGTH;
    }
}

/* Reason to reject the tag at `end`, if any; the comparison takes constant time. */
static inline enum omj_drop omj_check_tag(const uint8_t *packet, size_t end, const uint8_t *key)
{
    uint8_t tag[OMJ_TAG_SIZE];
    uint8_t difference = 0;
    size_t i;
    omj_blake2s(tag, OMJ_TAG_SIZE, key, OMJ_KEY_SIZE, packet, end);
    for (i = 0; i < OMJ_TAG_SIZE; i++) {
        difference |= (uint8_t)(tag[i] ^ packet[end + i]);
    }
    return difference ? OMJ_WRONG_TAG : OMJ_RIGHT;
}

/* Reads a packet; `frame` is valid only after OMJ_RIGHT. Without a key, tagged frames are dropped; with a key, frames
 * with a wrong tag or none. A stop passes in any case. */
static inline enum omj_drop omj_decode(const uint8_t *packet, size_t size, const uint8_t *key, omj_frame *frame)
{
    enum omj_drop wrong = key ? OMJ_NO_TAG : OMJ_RIGHT;
    size_t end;
    uint64_t flags;
    if (size < OMJ_HEADER_SIZE + OMJ_CHECKSUM_SIZE) {
        return OMJ_TOO_SHORT;
    }
    if (size > OMJ_LONGEST_FRAME) {
        return OMJ_TOO_LONG;
    }
    end = size - OMJ_CHECKSUM_SIZE;
    if (omj_crc32(packet, end) != (uint32_t)omj_get(packet + end, 4)) {
        return OMJ_CHECKSUM;
    }
    if (packet[0] != OMJ_PROTOCOL) {
        return OMJ_WRONG_PROTOCOL;
    }
    frame->type = packet[1];
    if (frame->type < OMJ_HELLO || frame->type > OMJ_CHALLENGE) {
        return OMJ_WRONG_TYPE;
    }
    flags = omj_get(packet + 2, 2);
    if (flags > OMJ_TAGGED) {
        return OMJ_WRONG_FLAGS;
    }
    if (flags) {
        if (end < OMJ_HEADER_SIZE + OMJ_TAG_SIZE) {
            return OMJ_LENGTH;
        }
        end -= OMJ_TAG_SIZE;
        wrong = key ? omj_check_tag(packet, end, key) : OMJ_NO_KEY;
    }
    if (wrong != OMJ_RIGHT && frame->type != OMJ_STOP) {
        return wrong;
    }
    frame->authentic = flags && wrong == OMJ_RIGHT;
    frame->session = (uint32_t)omj_get(packet + 4, 4);
    frame->sequence = (uint32_t)omj_get(packet + 8, 4);
    frame->time_us = omj_get(packet + 12, 8);
    frame->same_schema = omj_get(packet + 20, 4) == OMJ_SCHEMA;
    if (!frame->same_schema && (frame->type == OMJ_COMMAND || frame->type == OMJ_TELEMETRY)) {
        return OMJ_WRONG_SCHEMA;
    }
    return omj_get_payload(packet + OMJ_HEADER_SIZE, end - OMJ_HEADER_SIZE, frame);
}

#endif
