#pragma once

#include <cstddef>
#include <memory>

namespace camber {

namespace detail {
class DenseFlow;
}

/// Flows between images that several windows of a drive match, so that each is found once. For one
/// set of CorrespondenceOptions. Several threads may call.
class FlowCache {
 public:
  FlowCache();
  ~FlowCache();
  FlowCache(const FlowCache&) = delete;
  FlowCache& operator=(const FlowCache&) = delete;

  /// @param from, to  ids of images. @return empty: not kept.
  detail::DenseFlow find(int from, int to) const;
  void keep(int from, int to, detail::DenseFlow flow);
  /// Forgets the flows from and to images whose ids are smaller.
  void forget_before(int id);
  std::size_t size() const;  ///< flows kept

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
