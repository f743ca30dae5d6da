#include "camber/motion/flow_cache.h"

#include <map>
#include <mutex>
#include <utility>

#include "camber/motion/detail/inverse_search_flow.h"

namespace camber {

struct FlowCache::Impl {
  mutable std::mutex mutex;
  std::map<std::pair<int, int>, detail::DenseFlow> flows;
};

FlowCache::FlowCache() : impl_(std::make_unique<Impl>()) {}
FlowCache::~FlowCache() = default;

detail::DenseFlow FlowCache::find(int from, int to) const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const auto found = impl_->flows.find({from, to});
  return found == impl_->flows.end() ? detail::DenseFlow() : found->second;
}

void FlowCache::keep(int from, int to, detail::DenseFlow flow) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  impl_->flows[{from, to}] = std::move(flow);
}

void FlowCache::forget_before(int id) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  for (auto flow = impl_->flows.begin(); flow != impl_->flows.end();) {
    const auto& [from, to] = flow->first;
    flow = from < id || to < id ? impl_->flows.erase(flow) : std::next(flow);
  }
}

std::size_t FlowCache::size() const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return impl_->flows.size();
}

}  // namespace camber
