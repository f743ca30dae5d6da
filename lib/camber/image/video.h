#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/image/image.h"
#include "camber/image/image_io.h"
#include "camber/image/undistortion.h"

namespace camber {

/// A frame of a video, as a manifest names it: "drive.mp4#120".
struct VideoFrameName {
  std::filesystem::path file;
  int index = 0;  ///< of the whole frames in the order of presentation, from 0
};

/// What a path names where it is no file itself and ends in '#' and digits; nothing otherwise.
std::optional<VideoFrameName> video_frame_name(const std::filesystem::path& path);

/// The file that a frame's image comes from: the video, or the path itself.
std::filesystem::path image_file_of(const std::filesystem::path& path);

/// What a video states of itself.
struct VideoInfo {
  int width = 0, height = 0;  ///< pixels, after the rotation
  int rotation_deg = 0;       ///< clockwise, that the file asks for: 0, 90, 180 or 270
  std::string codec;
  double frame_rate = 0.0;  ///< average, Hz; 0: not known
  double duration_s = 0.0;  ///< 0: not known
  long stated_frames = 0;   ///< 0: the header has no count
};

/// Reads a video from its start, a frame at a time, each once. Frames that are damaged are passed
/// over and counted.
class VideoReader {
 public:
  virtual ~VideoReader() = default;
  virtual const VideoInfo& info() const = 0;
  /// Goes to the next whole frame. @return whether there was one.
  virtual bool next() = 0;
  virtual int index() const = 0;      ///< of that frame; -1 before the first
  virtual double time_s() const = 0;  ///< of its presentation since the first; rising
  virtual Image image() const = 0;    ///< 3 channels, upright
  virtual int damaged() const = 0;    ///< frames and packets that were passed over so far
};

/// Opens a video of any container and codec that FFmpeg's libraries decode. They bring many shared
/// libraries: a program can load them when this is first called (tools/plugins).
/// @throws InputError if it cannot be opened, or holds no video or one beyond 16384 pixels a side.
std::unique_ptr<VideoReader> open_video(const std::filesystem::path& path);

/// Reads the images of frames, files or frames of videos; a video is read on from where the last
/// frame was, so that frames asked for in their order take one pass.
class FrameImageReader {
 public:
  FrameImageReader();
  ~FrameImageReader();
  /// @throws InputError as read_frame_image(), and for a frame that the video does not have.
  FrameImage read(const std::filesystem::path& path, const PinholeCamera& camera);
  /// The same with the lens's distortion taken out: the file has the size of lens.raw().
  FrameImage read(const std::filesystem::path& path, const Undistortion& lens);

 private:
  std::filesystem::path file_;
  std::unique_ptr<VideoReader> video_;
};

/// The images of several frames, each video in one pass, on at most `num_threads` threads.
std::vector<FrameImage> read_frame_images(const std::vector<std::filesystem::path>& paths,
                                          const Undistortion& lens, int num_threads);

/// A scan of a whole video.
struct VideoScan {
  VideoInfo info;
  std::vector<double> times;  ///< s, of the whole frames
  int damaged = 0;
};

/// Decodes every frame of a video once. @throws InputError as open_video(), and without any frame.
VideoScan scan_video(const std::filesystem::path& path);

}  // namespace camber
