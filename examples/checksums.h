/* checksums.h: Adler-32 (RFC 1950) and CRC-32 (RFC 1952), which zlib, gzip, zip and others have. */

#ifndef EX_CHECKSUMS_H
#define EX_CHECKSUMS_H

#include "basics.h"

/* The remainders are due at least every 5552 bytes: until then 32 bits suffice. */
static inline uint32_t ex_adler32(const unsigned char *data, size_t size) {
    uint32_t sum = 1, sums = 0;
    for (size_t i = 0; i < size; ++i) {
        sums += sum += data[i];
        if (i % 4096 == 4095) sum %= 65521, sums %= 65521;
    }
    return sums % 65521 << 16 | sum % 65521;
}

static inline uint32_t ex_u32(const unsigned char *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static inline uint64_t ex_u64(const unsigned char *bytes) { return (uint64_t)ex_u32(bytes + 4) << 32 | ex_u32(bytes); }

/* Eight bytes at a time: table[k] has the effect of a byte that k more bytes follow. */
static inline uint32_t ex_crc32(const unsigned char *data, size_t size) {
    uint32_t table[8][256], crc = 0xffffffffu;
    for (uint32_t i = 0; i < 256; ++i) {
        table[0][i] = i;
        for (int bit = 0; bit < 8; ++bit) table[0][i] = table[0][i] >> 1 ^ (table[0][i] & 1 ? 0xedb88320u : 0);
    }
    for (int k = 1; k < 8; ++k)
        for (int i = 0; i < 256; ++i) table[k][i] = table[k - 1][i] >> 8 ^ table[0][table[k - 1][i] & 255];
    for (; size >= 8; size -= 8, data += 8) {
        const uint64_t word = ex_u64(data) ^ crc;
        crc = 0;
        for (int k = 0; k < 8; ++k) crc ^= table[7 - k][word >> 8 * k & 255];
    }
    for (; size > 0; --size) crc = crc >> 8 ^ table[0][(crc ^ *data++) & 255];
    return ~crc;
}

#endif /* EX_CHECKSUMS_H */
