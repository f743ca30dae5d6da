#include "camber/import/detail/compressed_bytes.h"

#include <fmt/format.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <cstddef>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace camber::detail {
namespace {

/// A size that a header claims is taken piece by piece, as the data gives it.
constexpr std::size_t kPiece = std::size_t{1} << 20;

class Lz4 {
 public:
  Lz4() {
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context_, LZ4F_VERSION))) {
      throw MachineError("lz4 cannot be started");
    }
  }
  ~Lz4() { LZ4F_freeDecompressionContext(context_); }
  Lz4(const Lz4&) = delete;
  Lz4& operator=(const Lz4&) = delete;
  LZ4F_dctx* get() { return context_; }

 private:
  LZ4F_dctx* context_ = nullptr;
};

class Zstd {
 public:
  Zstd() : stream_(ZSTD_createDStream()) {
    if (stream_ == nullptr) throw MachineError("zstd cannot be started");
  }
  ~Zstd() { ZSTD_freeDStream(stream_); }
  Zstd(const Zstd&) = delete;
  Zstd& operator=(const Zstd&) = delete;
  ZSTD_DStream* get() { return stream_; }

 private:
  ZSTD_DStream* stream_;
};

/// @param step  (out, room, in, left) -> consumed, produced; false at an error
template <typename Step>
std::string uncompress(std::string_view data, std::uint64_t most, Step&& step) {
  std::string out;
  std::size_t done = 0;
  while (done < data.size()) {
    const std::size_t old = out.size();
    const auto room = static_cast<std::size_t>(
        std::min<std::uint64_t>(kPiece, most + 1 - std::min<std::uint64_t>(old, most + 1)));
    if (room == 0) return out;
    out.resize(old + room);
    std::size_t produced = room, consumed = data.size() - done;
    if (!step(out.data() + old, &produced, data.data() + done, &consumed)) {
      out.resize(old);
      return out;
    }
    out.resize(old + produced);
    done += consumed;
    if (produced == 0 && consumed == 0) break;
  }
  // What the decoder still holds back.
  for (;;) {
    const std::size_t old = out.size();
    if (old > most) return out;
    out.resize(old + kPiece);
    std::size_t produced = kPiece, consumed = 0;
    if (!step(out.data() + old, &produced, data.data() + data.size(), &consumed)) produced = 0;
    out.resize(old + produced);
    if (produced == 0) return out;
  }
}

std::string uncompress_zstd_to(std::string_view data, std::uint64_t most) {
  Zstd zstd;
  return uncompress(data, most,
                    [&](char* out, std::size_t* produced, const char* in, std::size_t* consumed) {
                      ZSTD_inBuffer input{in, *consumed, 0};
                      ZSTD_outBuffer output{out, *produced, 0};
                      const std::size_t code = ZSTD_decompressStream(zstd.get(), &output, &input);
                      *produced = output.pos;
                      *consumed = input.pos;
                      return !ZSTD_isError(code);
                    });
}

}  // namespace

std::string uncompress_block(std::string_view compression, std::string_view data,
                             std::uint64_t size, const std::string& file,
                             const std::string& position) {
  std::string out;
  if (compression.empty()) {
    out = data;
  } else if (compression == "lz4") {
    Lz4 lz4;
    out = uncompress(data, size,
                     [&](char* to, std::size_t* produced, const char* from, std::size_t* consumed) {
                       const std::size_t code =
                           LZ4F_decompress(lz4.get(), to, produced, from, consumed, nullptr);
                       return LZ4F_isError(code) == 0;
                     });
  } else if (compression == "zstd") {
    out = uncompress_zstd_to(data, size);
  } else {
    throw InputError(
        file, position,
        "found the compression '" + printable(compression) + "', expected lz4 or zstd");
  }
  if (out.size() != size) {
    throw InputError(file, position,
                     fmt::format("found {} bytes that give {}{}, expected {} bytes", data.size(),
                                 out.size() > size ? "more than " : "",
                                 std::min<std::uint64_t>(out.size(), size), size));
  }
  return out;
}

std::string uncompress_zstd(std::string_view data, const std::string& file,
                            const std::string& position) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 31;
  const unsigned long long size = ZSTD_getFrameContentSize(data.data(), data.size());
  if (size == ZSTD_CONTENTSIZE_ERROR) {
    throw InputError(file, position, "found bytes that are not zstd, expected a zstd frame");
  }
  const bool known = size != ZSTD_CONTENTSIZE_UNKNOWN;
  std::string out = uncompress_zstd_to(data, known && size < kMost ? size : kMost);
  if ((known && out.size() != size) || out.size() > kMost) {
    throw InputError(
        file, position,
        fmt::format("found a zstd frame that gives {} bytes, expected {}", out.size(), size));
  }
  return out;
}

}  // namespace camber::detail
