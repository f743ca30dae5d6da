#include "camber/vehicle/detail/box_likelihood.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace camber::internal {

BoxLikelihood::BoxLikelihood(const PinholeCamera& camera, const Box2& box, const BoxNoise& noise,
                             int num_views)
    : gate_squared_(noise.gate * noise.gate) {
  const double body = noise.body_share * box.height();
  const auto sigma = [&](double side) {
    const double share = noise.side_share * side;
    return std::sqrt(share * share + noise.pixel_sigma * noise.pixel_sigma +
                     num_views * body * body);
  };
  const double su = sigma(box.width()), sv = sigma(box.height());
  const double right = camera.width - 1, bottom = camera.height - 1;
  edges_[0] = {0, -1.0, box.x1, su, 0.0};
  edges_[1] = {0, 1.0, box.x2, su, right};
  edges_[2] = {1, -1.0, box.y1, sv, 0.0};
  edges_[3] = {1, 1.0, box.y2, sv, bottom};
  for (Edge& edge : edges_) {
    const double inside = edge.sign * (edge.border - edge.pixel);
    edge.at_border = inside <= noise.border_px;
    edge.may_be_cut = inside <= std::max(noise.border_px, noise.border_sigmas * edge.sigma);
  }
}

Box2 BoxLikelihood::cuts() const {
  const auto limit = [&](std::size_t e) {
    const Edge& edge = edges_[e];
    return edge.at_border ? edge.pixel : edge.sign * std::numeric_limits<double>::infinity();
  };
  return {limit(0), limit(2), limit(1), limit(3)};
}

BoxLikelihood::Sides BoxLikelihood::sides(const BodyView& at) const {
  std::array<double, 4> extreme;
  extreme.fill(-std::numeric_limits<double>::infinity());
  std::array<int, 4> point_of{};
  for (int i = 0; i < kNumBodyPoints; ++i) {
    for (std::size_t e = 0; e < 4; ++e) {
      const double value = edges_[e].sign * at.pixel(i)[edges_[e].axis];
      if (value > extreme[e]) {
        extreme[e] = value;
        point_of[e] = i;
      }
    }
  }
  Sides out;
  for (std::size_t e = 0; e < 4; ++e) {
    const Edge& edge = edges_[e];
    const bool beyond = edge.may_be_cut && extreme[e] > edge.sign * edge.border;
    double outwards = (beyond ? edge.sign * edge.border : extreme[e]) - edge.sign * edge.pixel;
    if (edge.at_border && beyond) outwards = 0.0;
    const double r = outwards / edge.sigma;
    const double weight = beyond ? 0.0 : 1.0 / (1.0 + r * r / gate_squared_);
    out[e] = {point_of[e], edge.axis, edge.sign * outwards, weight / (edge.sigma * edge.sigma),
              r * r};
  }
  return out;
}

double BoxLikelihood::add(const BodyView& at, NormalEquations* equations) const {
  const Sides found = sides(at);
  double cost = 0.0;
  Eigen::MatrixXd jacobian;  // columns u, v
  if (equations) jacobian.resize(at.num_parameters(), 2);
  for (const Side& side : found) {
    cost += 0.5 * gate_squared_ * std::log1p(side.squared / gate_squared_);
    if (!equations) continue;
    at.jacobian(side.point, jacobian.col(0).data(), jacobian.col(1).data());
    const auto row = jacobian.col(side.axis);
    equations->hessian.noalias() += (side.information * row) * row.transpose();
    equations->gradient += (side.information * side.residual) * row;
  }
  return cost;
}

Box2 outline(const BodyView& at) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Box2 out{kInfinity, kInfinity, -kInfinity, -kInfinity};
  for (int i = 0; i < kNumBodyPoints; ++i) {
    const Eigen::Vector2d& pixel = at.pixel(i);
    out.x1 = std::min(out.x1, pixel.x());
    out.y1 = std::min(out.y1, pixel.y());
    out.x2 = std::max(out.x2, pixel.x());
    out.y2 = std::max(out.y2, pixel.y());
  }
  return out;
}

}  // namespace camber::internal
