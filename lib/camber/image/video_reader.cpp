#include <fmt/format.h>

#include <algorithm>
#include <cmath>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/imgutils.h>
#include <libswscale/swscale.h>
}

#include "camber/core/errors.h"
#include "camber/image/video.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kMaxSide = 16384;

template <auto Free>
struct FreeBy {
  template <typename T>
  void operator()(T* p) const {
    Free(&p);
  }
};
struct FreeSws {
  void operator()(SwsContext* p) const { sws_freeContext(p); }
};

std::string reason(int error) {
  char text[AV_ERROR_MAX_STRING_SIZE] = {0};
  av_strerror(error, text, sizeof text);
  return text;
}

/// Whether a format takes its pictures from other files, which it names.
bool names_other_files(const std::string& format) {
  for (const char* list : {"concat", "dash", "hls", "image2", "imf"}) {
    if (format == list) return true;
  }
  return false;
}

/// Clockwise quarter turns that make the picture upright, in degrees.
int rotation_of(const AVStream* stream) {
  const std::uint8_t* matrix = av_stream_get_side_data(stream, AV_PKT_DATA_DISPLAYMATRIX, nullptr);
  if (!matrix) return 0;
  const double angle = av_display_rotation_get(reinterpret_cast<const std::int32_t*>(matrix));
  if (!std::isfinite(angle)) return 0;
  const int turns = static_cast<int>(std::lround(-angle / 90.0));
  return ((turns % 4) + 4) % 4 * 90;
}

Image turned(const Image& in, int degrees) {
  if (degrees == 0) return in;
  Image out = in;
  if (degrees != 180) std::swap(out.width, out.height);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      int from_x = in.width - 1 - x, from_y = in.height - 1 - y;
      if (degrees == 90) {
        from_x = y;
        from_y = in.height - 1 - x;
      } else if (degrees == 270) {
        from_x = in.width - 1 - y;
        from_y = x;
      }
      const std::size_t to = 3 * (static_cast<std::size_t>(y) * out.width + x);
      std::copy_n(in.row(from_y) + 3 * static_cast<std::ptrdiff_t>(from_x), 3,
                  out.data.begin() + static_cast<std::ptrdiff_t>(to));
    }
  }
  return out;
}

class LibavReader : public VideoReader {
 public:
  explicit LibavReader(const fs::path& path) : path_(path) {
    std::error_code error;
    if (!fs::is_regular_file(path, error)) {
      throw InputError(path.string(), fs::exists(path, error) ? "is not a file, expected a video"
                                                              : "no such file");
    }
    av_log_set_level(AV_LOG_QUIET);
    open();
    describe();
  }

  const VideoInfo& info() const override { return info_; }
  int index() const override { return index_; }
  double time_s() const override { return time_; }
  int damaged() const override { return damaged_; }

  bool next() override {
    while (true) {
      const int status = avcodec_receive_frame(codec_.get(), frame_.get());
      if (status == 0) {
        if (take_frame()) return true;
        continue;
      }
      if (status == AVERROR_EOF || ended_) return false;
      if (status != AVERROR(EAGAIN)) ++damaged_;
      feed();
    }
  }

  Image image() const override {
    Image out{frame_->width, frame_->height, 3, {}};
    out.data.resize(3 * static_cast<std::size_t>(out.width) * out.height);
    // Accurate and the same on every processor.
    sws_.reset(sws_getCachedContext(
        sws_.release(), frame_->width, frame_->height, static_cast<AVPixelFormat>(frame_->format),
        frame_->width, frame_->height, AV_PIX_FMT_RGB24,
        SWS_BICUBIC | SWS_ACCURATE_RND | SWS_BITEXACT | SWS_FULL_CHR_H_INT, nullptr, nullptr,
        nullptr));
    if (!sws_)
      throw InputError(path_.string(), "found a pixel format that cannot be turned into colours");
    const bool high = frame_->height >= 720;
    const int matrix = frame_->colorspace == AVCOL_SPC_BT709 ||
                               (frame_->colorspace == AVCOL_SPC_UNSPECIFIED && high)
                           ? SWS_CS_ITU709
                           : SWS_CS_ITU601;
    const int full =
        frame_->color_range == AVCOL_RANGE_JPEG || is_full_range(frame_->format) ? 1 : 0;
    sws_setColorspaceDetails(sws_.get(), sws_getCoefficients(matrix), full,
                             sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
    // Vectorised code writes whole blocks: a padded buffer, then the rows.
    const int stride = (3 * out.width + 63) / 64 * 64;
    std::vector<std::uint8_t> padded(static_cast<std::size_t>(stride) * out.height + 64);
    std::uint8_t* to[4] = {padded.data(), nullptr, nullptr, nullptr};
    const int strides[4] = {stride, 0, 0, 0};
    sws_scale(sws_.get(), frame_->data, frame_->linesize, 0, frame_->height, to, strides);
    for (int y = 0; y < out.height; ++y) {
      std::copy_n(padded.begin() + static_cast<std::ptrdiff_t>(y) * stride, 3 * out.width,
                  out.data.begin() + 3 * static_cast<std::ptrdiff_t>(y) * out.width);
    }
    return turned(out, info_.rotation_deg);
  }

 private:
  static bool is_full_range(int format) {
    return format == AV_PIX_FMT_YUVJ420P || format == AV_PIX_FMT_YUVJ422P ||
           format == AV_PIX_FMT_YUVJ444P || format == AV_PIX_FMT_YUVJ440P ||
           format == AV_PIX_FMT_YUVJ411P;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw InputError(path_.string(), "found no video that can be read (" + what +
                                         "), expected an .mp4, .mkv, .avi or the like");
  }

  void open() {
    AVFormatContext* format = nullptr;
    AVDictionary* options = nullptr;
    av_dict_set(&options, "protocol_whitelist", "file", 0);  // a list may not lead into the network
    const int status =
        avformat_open_input(&format, ("file:" + path_.string()).c_str(), nullptr, &options);
    av_dict_free(&options);
    if (status < 0) refuse(reason(status));
    format_.reset(format);
    if (names_other_files(format->iformat->name)) refuse("it names other files");
    const int found = avformat_find_stream_info(format, nullptr);
    if (found < 0) refuse(reason(found));
    const AVCodec* decoder = nullptr;
    stream_ = av_find_best_stream(format, AVMEDIA_TYPE_VIDEO, -1, -1, &decoder, 0);
    if (stream_ < 0 || !decoder)
      refuse(stream_ < 0 ? "no stream of pictures" : "no decoder for its codec");
    codec_.reset(avcodec_alloc_context3(decoder));
    packet_.reset(av_packet_alloc());
    frame_.reset(av_frame_alloc());
    if (!codec_ || !packet_ || !frame_) throw MachineError("out of memory for a video decoder");
    avcodec_parameters_to_context(codec_.get(), stream()->codecpar);
    codec_->pkt_timebase = stream()->time_base;
    codec_->max_pixels = static_cast<std::int64_t>(kMaxSide) * kMaxSide;
    // Threads of a frame's slices: those of frames wait for each other for ever in damaged videos
    // (FFmpeg 5.1, MPEG-4).
    codec_->thread_type = FF_THREAD_SLICE;
    codec_->thread_count = 2;
    const int opened = avcodec_open2(codec_.get(), decoder, nullptr);
    if (opened < 0) refuse(reason(opened));
  }

  void describe() {
    const AVCodecParameters* p = stream()->codecpar;
    if (p->width < 1 || p->height < 1 || p->width > kMaxSide || p->height > kMaxSide) {
      refuse(fmt::format("{} x {} pixels", p->width, p->height));
    }
    info_.rotation_deg = rotation_of(stream());
    info_.width = info_.rotation_deg % 180 == 0 ? p->width : p->height;
    info_.height = info_.rotation_deg % 180 == 0 ? p->height : p->width;
    info_.codec = avcodec_get_name(p->codec_id);
    const AVRational rate = av_guess_frame_rate(format_.get(), stream(), nullptr);
    if (rate.num > 0 && rate.den > 0) info_.frame_rate = av_q2d(rate);
    info_.stated_frames = static_cast<long>(stream()->nb_frames);
    if (stream()->duration > 0) {
      info_.duration_s = static_cast<double>(stream()->duration) * av_q2d(stream()->time_base);
    } else if (format_->duration > 0) {
      info_.duration_s = static_cast<double>(format_->duration) / AV_TIME_BASE;
    }
  }

  AVStream* stream() const { return format_->streams[stream_]; }

  /// One packet of the stream to the decoder, or the end.
  void feed() {
    while (true) {
      const int status = av_read_frame(format_.get(), packet_.get());
      if (status == AVERROR(EAGAIN)) continue;
      if (status < 0) {
        if (status != AVERROR_EOF) ++damaged_;
        if (drained_) {
          ended_ = true;
        } else {
          avcodec_send_packet(codec_.get(), nullptr);
          drained_ = true;
        }
        return;
      }
      const bool ours = packet_->stream_index == stream_;
      const bool corrupt = (packet_->flags & AV_PKT_FLAG_CORRUPT) != 0;
      int sent = 0;
      if (ours && !corrupt) sent = avcodec_send_packet(codec_.get(), packet_.get());
      if (ours && (corrupt || (sent < 0 && sent != AVERROR(EAGAIN)))) ++damaged_;
      av_packet_unref(packet_.get());
      if (ours) return;
    }
  }

  /// Whether the decoded frame is whole; gives it its number and time.
  bool take_frame() {
    if ((frame_->flags & (AV_FRAME_FLAG_CORRUPT | AV_FRAME_FLAG_DISCARD)) != 0 ||
        frame_->decode_error_flags != 0) {
      ++damaged_;
      return false;
    }
    const AVCodecParameters* p = stream()->codecpar;
    if (frame_->width != p->width || frame_->height != p->height) {
      throw InputError(path_.string(), fmt::format("frame {}", index_ + 1),
                       fmt::format("found {} x {} pixels, expected {} x {} as in the first",
                                   frame_->width, frame_->height, p->width, p->height));
    }
    const double step = info_.frame_rate > 0.0 ? 1.0 / info_.frame_rate : 0.1;
    double time = index_ < 0 ? 0.0 : time_ + step;
    if (frame_->best_effort_timestamp != AV_NOPTS_VALUE) {
      const double stamp =
          static_cast<double>(frame_->best_effort_timestamp) * av_q2d(stream()->time_base);
      if (index_ < 0) start_ = stamp;
      if (index_ < 0 || stamp - start_ > time_) time = stamp - start_;
    }
    time_ = time;
    ++index_;
    return true;
  }

  fs::path path_;
  VideoInfo info_;
  struct CloseFormat {
    void operator()(AVFormatContext* p) const { avformat_close_input(&p); }
  };
  std::unique_ptr<AVFormatContext, CloseFormat> format_;
  std::unique_ptr<AVCodecContext, FreeBy<avcodec_free_context>> codec_;
  std::unique_ptr<AVPacket, FreeBy<av_packet_free>> packet_;
  std::unique_ptr<AVFrame, FreeBy<av_frame_free>> frame_;
  mutable std::unique_ptr<SwsContext, FreeSws> sws_;
  int stream_ = -1, index_ = -1, damaged_ = 0;
  double time_ = 0.0, start_ = 0.0;
  bool drained_ = false, ended_ = false;
};

}  // namespace

std::unique_ptr<VideoReader> open_video(const fs::path& path) {
  return std::make_unique<LibavReader>(path);
}

}  // namespace camber
