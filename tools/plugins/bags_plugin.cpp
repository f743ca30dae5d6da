#include "camber/export/mcap_file.h"
#include "plugin.h"
#include "recording_plugin.h"

namespace {

std::unique_ptr<camber::MessageSink> make_sink(std::ostream& out) {
  return std::make_unique<camber::McapWriter>(out);
}

}  // namespace

CAMBER_EXPORT const camber::tools::RecordingFunctions* camber_bags();
CAMBER_EXPORT const camber::tools::RecordingFunctions* camber_bags() {
  static const camber::tools::RecordingFunctions functions = {camber::open_recording, make_sink};
  return &functions;
}
