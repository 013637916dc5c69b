// The firmware's protocol on the host. `decode`: packets of standard input as text. `echo`: packets
// of standard input, encoded again. `answer`: replies to the commands, as the sketch gives them.
#include <cstdio>
#include <cstring>

#include "protocol.h"

using namespace spadcam;

int main(int, char **arguments) {
  Parser parser;
  Settings settings;
  Packet packet;
  Outbox<2048> outbox;
  uint8_t line[LONGEST + 1], payload[IDENTITY_BYTES];
  for (int byte; (byte = getchar()) != EOF;) {
    if (!parser.take(static_cast<uint8_t>(byte), packet)) continue;
    if (!strcmp(arguments[1], "decode")) {
      printf("%d %u %llu ", packet.kind, packet.sequence, (unsigned long long)packet.device_us);
      for (int i = 0; i < payload_bytes(packet.kind); ++i) printf("%02x", packet.payload[i]);
      printf("\n");
      continue;
    }
    if (!strcmp(arguments[1], "answer")) {
      if (packet.kind == IDENTIFY) {
        write_identity(payload, "0123456789ABCDEF", "spadcam 1.0");
        packet.kind = IDENTITY;
      } else {
        settings.write(payload, !settings.apply(packet));
        packet.kind = SETTINGS;
      }
      packet.payload = payload;
    }
    if (!outbox.put(line, encode(packet, line))) return 1;
    const uint8_t *bytes;
    while (size_t count = outbox.next(bytes)) outbox.sent(fwrite(bytes, 1, count, stdout));
  }
  fprintf(stderr, "%u", parser.damaged);
}
