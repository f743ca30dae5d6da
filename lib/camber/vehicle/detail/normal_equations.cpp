#include "camber/vehicle/detail/normal_equations.h"

namespace camber::internal {

void scatter(const Eigen::Ref<const Eigen::MatrixXd>& hessian,
             const Eigen::Ref<const Eigen::VectorXd>& gradient,
             const std::vector<ParameterRun>& runs, NormalEquations* all) {
  for (const ParameterRun& p : runs) {
    all->gradient.segment(p.all, p.length) += gradient.segment(p.own, p.length);
    for (const ParameterRun& q : runs) {
      all->hessian.block(p.all, q.all, p.length, q.length) +=
          hessian.block(p.own, q.own, p.length, q.length);
    }
  }
}

}  // namespace camber::internal
