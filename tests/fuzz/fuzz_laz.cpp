// Any bytes as a LAZ file: its points read strictly, leniently and by the levels of COPC; what is
// read strictly comes back from a LAZ file that is written of it.

#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"

namespace {

/// A few bytes can stand for very many equal points, which take their time.
constexpr std::size_t kMostPoints = 20000;

/// @return whether all points were read
bool read(camber::PointSource& source, std::string* records) {
  camber::PointBatch batch;
  std::size_t count = 0;
  while (source.next(batch)) {
    for (std::size_t i = 0; i < batch.count && batch.records.data != nullptr; ++i) {
      records->append(reinterpret_cast<const char*>(batch.records.data + i * batch.records.stride),
                      batch.records.stride);
    }
    count += batch.count;
    if (count > kMostPoints) return false;
  }
  return true;
}

void write_and_read(const std::uint8_t* data, std::size_t size, const std::string& records,
                    const camber::ReadOptions& options) {
  const auto source = camber::open_point_source(data, size, "input", options);
  std::ostringstream out;
  const auto sink = camber::make_point_sink(out, source->header(), camber::CloudFormat::kLaz,
                                            camber::CloudEncoding::kBinary);
  camber::PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  const std::string bytes = out.str();
  const auto again = camber::open_point_source(bytes.data(), bytes.size(), "copy", options);
  std::string copied;
  if (!read(*again, &copied) || copied != records) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  for (const int way : {0, 1, 2, 3}) {
    camber::ReadOptions options;
    options.format = camber::CloudFormat::kLaz;
    options.num_threads = 1;
    options.lenient = way == 1;
    if (way == 2) options.resolution = 5.0;
    if (way == 3) options.attributes = {"classification"};
    try {
      std::string records;
      const auto source = camber::open_point_source(data, size, "input", options);
      const bool whole = read(*source, &records);
      if (way == 0 && whole) write_and_read(data, size, records, options);
    } catch (const camber::InputError&) {
      // what a reader of untrusted files answers
    } catch (const std::invalid_argument&) {
      // what cannot be written as LAZ
    }
  }
  return 0;
}
