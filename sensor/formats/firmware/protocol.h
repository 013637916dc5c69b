// SPADCAM's serial protocol: packets, settings and send queue, described in docs/reference/spadcam-protocol.md.
// Plain C++ without Arduino, so that it can be tested on the host.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace spadcam {

constexpr uint8_t VERSION = 1;
constexpr size_t ROWS = 16;
constexpr size_t COLUMNS = 16;
constexpr uint16_t NOT_READ = 0xFFFF;

enum Kind : uint8_t {
  FRAME = 1,
  IDENTITY = 2,
  SETTINGS = 3,
  IDENTIFY = 16,
  SET_EXPOSURE = 17,
  SET_FRAME_RATE = 18,
  SET_STEP_BIAS = 19,
  SET_ROW_WINDOW = 20,
};

constexpr size_t HEADER_BYTES = 14;
constexpr size_t CHECK_BYTES = 6;
constexpr size_t FRAME_BYTES = 2 * ROWS * COLUMNS;
constexpr size_t IDENTITY_BYTES = 56;
constexpr size_t SETTINGS_BYTES = 14;
constexpr size_t LARGEST_BODY = HEADER_BYTES + FRAME_BYTES + CHECK_BYTES;
// COBS adds a byte for every 254; the zero is not counted.
constexpr size_t LONGEST = LARGEST_BODY + (LARGEST_BODY + 253) / 254;

// Bytes of a kind's payload, -1 of an unknown kind.
int payload_bytes(uint8_t kind);

struct Packet {
  uint8_t kind;
  uint32_t sequence;
  uint64_t device_us;
  const uint8_t *payload;  // from a Parser: valid until it takes the next byte
};

// Writes a packet with its zero to `line`, which has room for LONGEST + 1; returns the bytes written.
size_t encode(const Packet &packet, uint8_t *line);

// Finds packets in bytes, damaged or not, without waiting or growing.
class Parser {
 public:
  // Takes one byte; true if it completes a packet.
  bool take(uint8_t byte, Packet &packet);
  uint32_t damaged = 0;

 private:
  bool decode(Packet &packet);
  uint8_t bytes_[LONGEST];
  size_t length_ = 0;
  bool is_too_long_ = false;
};

struct Settings {
  uint32_t exposure_us = 50000;
  uint32_t frame_rate_mhz = 10000;
  uint16_t step_bias = 2048;
  uint8_t first_row = 0;
  uint8_t end_row = ROWS;

  uint32_t period_us() const { return 1000000000u / frame_rate_mhz; }
  bool are_possible() const;
  // Executes a command; false if it is impossible, without any change.
  bool apply(const Packet &command);
  void write(uint8_t *payload, bool refused) const;
};

void write_identity(uint8_t *payload, const char *serial_number, const char *firmware);

// Send queue to the host: accepts packets completely or not at all, without waiting.
template <size_t SIZE>
class Outbox {
 public:
  bool put(const uint8_t *bytes, size_t count) {
    if (SIZE - used_ < count) return false;
    for (size_t i = 0; i < count; ++i) bytes_[(first_ + used_ + i) % SIZE] = bytes[i];
    used_ += count;
    return true;
  }
  // The longest contiguous piece.
  size_t next(const uint8_t *&bytes) const {
    bytes = bytes_ + first_;
    return used_ < SIZE - first_ ? used_ : SIZE - first_;
  }
  void sent(size_t count) {
    first_ = (first_ + count) % SIZE;
    used_ -= count;
  }

 private:
  uint8_t bytes_[SIZE];
  size_t first_ = 0;
  size_t used_ = 0;
};

}  // namespace spadcam
