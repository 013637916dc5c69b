// SPADCAM on a Teensy 3.2 (board "Teensy 3.2 / 3.1", USB type "Serial").
//
// A frame: a global reset recharges all counters to the supply, they count for the exposure, and the
// pixels are read one after the other through the ADC. Frames are sent at once. Commands are drained in
// every pass and between rows. A frame that does not fit into the buffer is dropped without waiting;
// the host detects its missing number.
//
// The pins are examples: adapt them to your wiring.
#include "protocol.h"

using namespace spadcam;

constexpr uint8_t RESET_PIN = 2;              // high: all counters are at the supply
constexpr uint8_t ROW_PINS[] = {3, 4, 5, 6};  // row address, lowest bit first
constexpr uint8_t COLUMN_PINS[] = {7, 8, 9, 10};
constexpr uint8_t OUTPUT_PIN = A0;  // output of the source followers
constexpr uint8_t BIAS_PIN = A14;   // DAC: bias of the counters' step
constexpr uint32_t RESET_US = 5;
const char FIRMWARE[] = "spadcam 1.0";

Parser parser;
Settings settings;
Outbox<24576> outbox;
uint8_t line[LONGEST + 1];
uint16_t samples[ROWS * COLUMNS];
uint32_t frame_number = 0;
uint64_t frame_start_us = 0;

// micros() restarts every 71 minutes; this does not, if it is called more often than that.
uint64_t now_us() {
  static uint32_t last = 0;
  static uint64_t wraps = 0;
  const uint32_t now = micros();
  if (now < last) wraps += 1ull << 32;
  last = now;
  return wraps + now;
}

bool post(uint8_t kind, uint32_t sequence, uint64_t time_us, const uint8_t *payload) {
  return outbox.put(line, encode(Packet{kind, sequence, time_us, payload}, line));
}

void answer(const Packet &command) {
  static uint8_t payload[IDENTITY_BYTES];
  if (command.kind == IDENTIFY) {
    char serial_number[17];
    snprintf(serial_number, sizeof serial_number, "%08lX%08lX", SIM_UIDML, SIM_UIDL);
    write_identity(payload, serial_number, FIRMWARE);
    post(IDENTITY, command.sequence, now_us(), payload);
  } else if (command.kind > IDENTIFY) {
    const bool is_done = settings.apply(command);
    analogWrite(BIAS_PIN, settings.step_bias);
    settings.write(payload, !is_done);
    post(SETTINGS, command.sequence, now_us(), payload);
  }
}

void serve_line() {
  Packet command;
  while (Serial.available() > 0) {
    if (parser.take(Serial.read(), command)) answer(command);
  }
  const uint8_t *bytes;
  const size_t waiting = outbox.next(bytes);
  const size_t room = Serial.availableForWrite();
  const size_t count = waiting < room ? waiting : room;
  if (count > 0) outbox.sent(Serial.write(bytes, count));
}

void select(const uint8_t *pins, size_t address) {
  for (size_t bit = 0; bit < 4; ++bit) digitalWriteFast(pins[bit], address >> bit & 1);
}

void read_out(uint8_t first_row, uint8_t end_row) {
  for (size_t row = 0; row < ROWS; ++row) {
    const bool is_read = first_row <= row && row < end_row;
    select(ROW_PINS, row);
    for (size_t column = 0; column < COLUMNS; ++column) {
      select(COLUMN_PINS, column);
      samples[row * COLUMNS + column] = is_read ? analogRead(OUTPUT_PIN) : NOT_READ;
    }
    serve_line();
  }
}

void reset_counters() {
  digitalWriteFast(RESET_PIN, HIGH);
  delayMicroseconds(RESET_US);
  digitalWriteFast(RESET_PIN, LOW);
  frame_start_us = now_us();
}

void setup() {
  pinMode(RESET_PIN, OUTPUT);
  for (uint8_t pin : ROW_PINS) pinMode(pin, OUTPUT);
  for (uint8_t pin : COLUMN_PINS) pinMode(pin, OUTPUT);
  analogReadResolution(12);
  analogReadAveraging(1);
  analogWriteResolution(12);
  analogWrite(BIAS_PIN, settings.step_bias);
  Serial.begin(115200);  // USB ignores the number
  reset_counters();
}

void loop() {
  serve_line();
  static Settings taken = settings;  // settings of the current exposure
  static bool is_exposing = true;
  const uint64_t elapsed_us = now_us() - frame_start_us;
  if (is_exposing && elapsed_us >= taken.exposure_us) {
    const uint64_t end_us = now_us();
    read_out(taken.first_row, taken.end_row);
    // Little-endian, like the packet.
    post(FRAME, frame_number++, end_us, reinterpret_cast<const uint8_t *>(samples));
    is_exposing = false;
  } else if (!is_exposing && elapsed_us >= taken.period_us()) {
    taken = settings;
    reset_counters();
    is_exposing = true;
  }
}
