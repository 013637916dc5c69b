#include "protocol.h"

#include <string.h>

namespace spadcam {
namespace {

void put(uint8_t *&at, uint64_t value, size_t bytes) {
  for (size_t i = 0; i < bytes; ++i) *at++ = static_cast<uint8_t>(value >> (8 * i));
}

uint64_t get(const uint8_t *at, size_t bytes) {
  uint64_t value = 0;
  for (size_t i = 0; i < bytes; ++i) value |= static_cast<uint64_t>(at[i]) << (8 * i);
  return value;
}

uint32_t adler32(const uint8_t *bytes, size_t count) {
  uint32_t low = 1, high = 0;
  for (size_t i = 0; i < count; ++i) {
    low = (low + bytes[i]) % 65521;
    high = (high + low) % 65521;
  }
  return high << 16 | low;
}

uint16_t crc16(const uint8_t *bytes, size_t count) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < count; ++i) {
    crc ^= static_cast<uint16_t>(bytes[i] << 8);
    for (int bit = 0; bit < 8; ++bit) crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
  }
  return crc;
}

// Appends both checks to `count` bytes.
void check(uint8_t *body, size_t count) {
  uint8_t *at = body + count;
  put(at, adler32(body, count), 4);
  put(at, crc16(body, count + 4), 2);
}

size_t cobs(const uint8_t *body, size_t count, uint8_t *line) {
  size_t code_at = 0, out = 1;
  uint8_t code = 1;
  for (size_t i = 0; i < count; ++i) {
    if (body[i] != 0) {
      line[out++] = body[i];
      ++code;
    }
    // A full block at the very end needs no further code.
    if (body[i] == 0 || (code == 0xFF && i + 1 < count)) {
      line[code_at] = code;
      code_at = out++;
      code = 1;
    }
  }
  line[code_at] = code;
  line[out++] = 0;
  return out;
}

// Undoes COBS in place; returns the number of bytes, 0 if it is damaged.
size_t uncobs(uint8_t *bytes, size_t count) {
  size_t in = 0, out = 0;
  while (in < count) {
    const uint8_t code = bytes[in++];
    if (in + code - 1 > count) return 0;
    for (uint8_t i = 1; i < code; ++i) bytes[out++] = bytes[in++];
    if (code != 0xFF && in < count) bytes[out++] = 0;
  }
  return out;
}

}  // namespace

int payload_bytes(uint8_t kind) {
  switch (kind) {
    case FRAME: return FRAME_BYTES;
    case IDENTITY: return IDENTITY_BYTES;
    case SETTINGS: return SETTINGS_BYTES;
    case IDENTIFY: return 0;
    case SET_EXPOSURE: return 4;
    case SET_FRAME_RATE: return 4;
    case SET_STEP_BIAS: return 2;
    case SET_ROW_WINDOW: return 2;
    default: return -1;
  }
}

size_t encode(const Packet &packet, uint8_t *line) {
  static uint8_t body[LARGEST_BODY];
  uint8_t *at = body;
  put(at, VERSION, 1);
  put(at, packet.kind, 1);
  put(at, packet.sequence, 4);
  put(at, packet.device_us, 8);
  const size_t content = HEADER_BYTES + payload_bytes(packet.kind);
  if (content > HEADER_BYTES) memcpy(at, packet.payload, content - HEADER_BYTES);
  check(body, content);
  return cobs(body, content + CHECK_BYTES, line);
}

bool Parser::take(uint8_t byte, Packet &packet) {
  if (byte != 0) {
    if (length_ == LONGEST) is_too_long_ = true;
    else bytes_[length_++] = byte;
    return false;
  }
  const bool is_empty = length_ == 0;
  const bool is_whole = !is_empty && !is_too_long_ && decode(packet);
  if (!is_whole && !is_empty) ++damaged;
  length_ = 0;
  is_too_long_ = false;
  return is_whole;
}

bool Parser::decode(Packet &packet) {
  const size_t count = uncobs(bytes_, length_);
  if (count < HEADER_BYTES + CHECK_BYTES) return false;
  const size_t content = count - CHECK_BYTES;
  if (get(bytes_ + content, 4) != adler32(bytes_, content)) return false;
  if (get(bytes_ + content + 4, 2) != crc16(bytes_, content + 4)) return false;
  const int payload = payload_bytes(bytes_[1]);
  if (bytes_[0] != VERSION || payload < 0) return false;
  if (content != HEADER_BYTES + static_cast<size_t>(payload)) return false;
  packet.kind = bytes_[1];
  packet.sequence = static_cast<uint32_t>(get(bytes_ + 2, 4));
  packet.device_us = get(bytes_ + 6, 8);
  packet.payload = bytes_ + HEADER_BYTES;
  return true;
}

bool Settings::are_possible() const {
  return frame_rate_mhz > 0 && exposure_us > 0 && exposure_us <= period_us() &&
         step_bias <= 4095 && first_row < end_row && end_row <= ROWS;
}

bool Settings::apply(const Packet &command) {
  Settings wanted = *this;
  const uint8_t *payload = command.payload;
  switch (command.kind) {
    case SET_EXPOSURE: wanted.exposure_us = static_cast<uint32_t>(get(payload, 4)); break;
    case SET_FRAME_RATE: wanted.frame_rate_mhz = static_cast<uint32_t>(get(payload, 4)); break;
    case SET_STEP_BIAS: wanted.step_bias = static_cast<uint16_t>(get(payload, 2)); break;
    case SET_ROW_WINDOW:
      wanted.first_row = payload[0];
      wanted.end_row = payload[1];
      break;
    default: return false;
  }
  if (!wanted.are_possible()) return false;
  *this = wanted;
  return true;
}

void Settings::write(uint8_t *payload, bool refused) const {
  put(payload, refused, 2);
  put(payload, exposure_us, 4);
  put(payload, frame_rate_mhz, 4);
  put(payload, step_bias, 2);
  put(payload, first_row, 1);
  put(payload, end_row, 1);
}

void write_identity(uint8_t *payload, const char *serial_number, const char *firmware) {
  memset(payload, 0, IDENTITY_BYTES);
  uint8_t *at = payload;
  put(at, ROWS, 1);
  put(at, COLUMNS, 1);
  put(at, 12, 2);    // bits of the ADC
  put(at, 3300, 4);  // supply, mV
  strncpy(reinterpret_cast<char *>(payload + 8), serial_number, 16);
  strncpy(reinterpret_cast<char *>(payload + 24), firmware, 32);
}

}  // namespace spadcam
