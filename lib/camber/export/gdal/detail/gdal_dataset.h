#pragma once

#include <cpl_error.h>
#include <gdal.h>

#include <array>
#include <memory>
#include <string>

/// What all that writes by GDAL shares. Not installed: its header includes GDAL's.
namespace camber::detail {

/// Keeps GDAL from printing and remembers its first complaint: some functions make one and return
/// as if all were well.
class Complaints {
 public:
  Complaints();
  ~Complaints();
  Complaints(const Complaints&) = delete;
  Complaints& operator=(const Complaints&) = delete;

  /// Refuses where a call was not done or GDAL has complained. What is written is sound and the
  /// file is in memory: only that can be short.
  void check(bool is_done) const;
  /// The first complaint; empty: none.
  std::string first() const { return first_.data(); }

 private:
  static void CPL_STDCALL keep(CPLErr kind, CPLErrorNum, const char* message);

  std::array<char, 200> first_{};
};

using Dataset = std::unique_ptr<void, void (*)(GDALDatasetH)>;
Dataset owned(GDALDatasetH file);

/// @throws NoAnswerError for a system that GDAL does not know. @return false for want of memory
bool set_system(GDALDatasetH file, const std::string& crs);

}  // namespace camber::detail
