/* zip.h: finds a file in a zip archive (PKWARE's APPNOTE.TXT), such as an .npz. Not read: zip64 (archives or members of
   4 GB and more), archives in several parts, encrypted members, and packings other than deflate. */

#ifndef EX_ZIP_H
#define EX_ZIP_H

#include "files.h"
#include "checksums.h"

typedef struct ex_zip_member {
    char name[256];
    uint64_t at, packed_size; /* its first byte in the archive; bytes there */
    uint64_t size;            /* bytes when unpacked */
    uint32_t crc;             /* CRC-32 of the unpacked bytes */
    int is_deflated;
} ex_zip_member;

/* A zip file while its list of members is read. */
typedef struct ex_zip {
    const char *path;
    FILE *file;
    uint64_t held;
    unsigned char *list; /* members, at the end of the archive */
    size_t list_size;
    unsigned count; /* number of members */
    ex_error *error;
} ex_zip;

static inline unsigned ex_u16(const unsigned char *bytes) { return bytes[0] | (unsigned)bytes[1] << 8; }

static inline int ex_zip_fail(const ex_zip *zip, uint64_t at, const char *what) {
    return ex_fail(zip->error, "%s: zip: byte %llu: %s", zip->path, (unsigned long long)at, what);
}

static inline int ex_zip_bytes(const ex_zip *zip, uint64_t at, unsigned char *out, size_t size) {
    if (fseeko(zip->file, (off_t)at, SEEK_SET) == 0 && fread(out, 1, size, zip->file) == size) return 0;
    return ex_zip_fail(zip, at, "reading failed");
}

/* The last record has 22 bytes and a comment of up to 65535; it says where the list of members is. */
static inline int ex_zip_find_list(ex_zip *zip) {
    const size_t size = zip->held < 65557 ? (size_t)zip->held : 65557;
    const uint64_t from = zip->held - size;
    unsigned char *tail = (unsigned char *)ex_allocate(size, 1), *at = NULL;
    if (ex_zip_bytes(zip, from, tail, size)) {
        free(tail);
        return 1;
    }
    for (size_t i = size; i-- > 0 && !at;)
        if (size - i >= 22 && ex_u32(tail + i) == 0x06054b50 && ex_u16(tail + i + 20) <= size - i - 22) at = tail + i;
    const uint64_t end = at ? from + (uint64_t)(at - tail) : 0;
    const uint32_t parts = at ? ex_u32(at + 4) : 0, start = at ? ex_u32(at + 16) : 0;
    zip->count = at ? ex_u16(at + 10) : 0;
    zip->list_size = at ? ex_u32(at + 12) : 0;
    free(tail);
    if (!at) return ex_fail(zip->error, "%s: not a zip file: it has no list of members", zip->path);
    if (start == 0xffffffffu || zip->list_size == 0xffffffffu || zip->count == 0xffff)
        return ex_zip_fail(zip, end, "zip64, which is not supported: 4 GB and more");
    if (parts != 0) return ex_zip_fail(zip, end, "an archive in several parts is not supported");
    if (start > end || zip->list_size > end - start)
        return ex_zip_fail(zip, end, "the list of members is not in the file");
    if (zip->list_size > 1 << 20) return ex_zip_fail(zip, end, "a list of members of more than 1 MB");
    zip->list = (unsigned char *)ex_allocate(zip->list_size, 1);
    return ex_zip_bytes(zip, start, zip->list, zip->list_size);
}

/* Reads one entry of the list and moves on. */
static inline int ex_zip_next(const ex_zip *zip, size_t *place, ex_zip_member *member) {
    const unsigned char *at = zip->list + *place;
    const size_t left = zip->list_size - *place;
    if (left < 46 || ex_u32(at) != 0x02014b50 || ex_u16(at + 28) > left - 46)
        return ex_fail(zip->error, "%s: zip: the list of members is cut off or malformed", zip->path);
    const size_t name = ex_u16(at + 28), size = 46 + name + ex_u16(at + 30) + ex_u16(at + 32);
    if (size > left) return ex_fail(zip->error, "%s: zip: the list of members is cut off or malformed", zip->path);
    if (name >= sizeof member->name) return ex_fail(zip->error, "%s: zip: a name of %zu characters", zip->path, name);
    memcpy(member->name, at + 46, name);
    member->name[name] = '\0';
    member->crc = ex_u32(at + 16), member->packed_size = ex_u32(at + 20), member->size = ex_u32(at + 24);
    member->at = ex_u32(at + 42);
    member->is_deflated = ex_u16(at + 10) == 8;
    *place += size;
    const ex_quote shown = ex_quoted(member->name);
    if (ex_u16(at + 8) & 1) return ex_fail(zip->error, "%s: zip: '%s' is encrypted", zip->path, shown.text);
    if (ex_u16(at + 10) != 0 && !member->is_deflated)
        return ex_fail(zip->error, "%s: zip: '%s' is packed by method %u; only deflate is supported", zip->path,
                       shown.text, ex_u16(at + 10));
    if (member->packed_size == 0xffffffffu || member->size == 0xffffffffu || member->at == 0xffffffffu)
        return ex_fail(zip->error, "%s: zip: '%s' is zip64, which is not supported", zip->path, shown.text);
    return 0;
}

/* Moves from the member's own header, which repeats the list and may be longer, to its data. */
static inline int ex_zip_enter(const ex_zip *zip, ex_zip_member *member) {
    unsigned char header[30];
    if (member->at > zip->held || zip->held - member->at < sizeof header)
        return ex_zip_fail(zip, member->at, "a member is not in the file");
    if (ex_zip_bytes(zip, member->at, header, sizeof header)) return 1;
    if (ex_u32(header) != 0x04034b50) return ex_zip_fail(zip, member->at, "no member begins here");
    const uint64_t at = member->at + sizeof header + ex_u16(header + 26) + ex_u16(header + 28);
    if (at > zip->held || member->packed_size > zip->held - at)
        return ex_zip_fail(zip, member->at, "a member is not in the file");
    member->at = at;
    return 0;
}

/* Whether a name ends like that. */
static inline int ex_has_ending(const char *name, const char *ending) {
    const size_t length = strlen(name), end = strlen(ending);
    return length >= end && strcmp(name + length - end, ending) == 0;
}

/* Chooses the member `wanted` among those with an ending, which need not be given; NULL: the only one. */
static inline int ex_zip_choose(const ex_zip *zip, const char *wanted, const char *ending, ex_zip_member *found) {
    char names[300] = "";
    size_t place = 0, used = 0;
    int count = 0, chosen = 0;
    ex_zip_member member;
    for (unsigned i = 0; i < zip->count; ++i) {
        if (ex_zip_next(zip, &place, &member)) return 1;
        if (!ex_has_ending(member.name, ending)) continue;
        const size_t length = strlen(member.name) - strlen(ending);
        const int fits = !wanted || strcmp(member.name, wanted) == 0 ||
                         (strlen(wanted) == length && strncmp(member.name, wanted, length) == 0);
        if (fits && !chosen) *found = member, chosen = 1;
        ++count;
        const int added = snprintf(names + used, sizeof names - used, " %.*s", (int)length, member.name);
        if (used + (size_t)added < sizeof names) used += (size_t)added;
    }
    if (count == 0) return ex_fail(zip->error, "%s: zip: there is no %s in it", zip->path, ending);
    if (!chosen) return ex_fail(zip->error, "%s: zip: '%s' is not in it; there are%s", zip->path, wanted, names);
    if (!wanted && count > 1)
        return ex_fail(zip->error, "%s: zip: it has %d arrays instead of one:%s", zip->path, count, names);
    return 0;
}

/* Finds a member, as ex_zip_choose does, and where its data are. */
static inline int ex_zip_find(const char *path, const char *wanted, const char *ending, ex_zip_member *found,
                              ex_error *error) {
    ex_zip zip;
    memset(&zip, 0, sizeof zip);
    zip.path = path, zip.error = error;
    zip.file = ex_open(path, &zip.held, error);
    if (!zip.file) return 1;
    const int failed =
        ex_zip_find_list(&zip) || ex_zip_choose(&zip, wanted, ending, found) || ex_zip_enter(&zip, found);
    free(zip.list);
    fclose(zip.file);
    return failed;
}

#endif /* EX_ZIP_H */
