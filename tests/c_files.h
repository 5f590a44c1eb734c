/* Files of a folder, for the programs that are tests: a failure ends the program. */
#ifndef C_FILES_H
#define C_FILES_H

#include <stdio.h>
#include <stdlib.h>

static const char *folder;

static void *room(size_t bytes) {
    void *memory = calloc(bytes, 1);
    if (memory == NULL) exit(3);
    return memory;
}

static FILE *opened(const char *name, const char *mode) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, mode);
    if (file == NULL) exit(4);
    return file;
}

static void read_all(const char *name, void *data, size_t bytes) {
    FILE *file = opened(name, "rb");
    if (fread(data, 1, bytes, file) != bytes) exit(5);
    fclose(file);
}

static void write_all(const char *name, const void *data, size_t bytes) {
    FILE *file = opened(name, "wb");
    if (fwrite(data, 1, bytes, file) != bytes) exit(6);
    fclose(file);
}

#endif
