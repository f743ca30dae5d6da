#include <fmt/format.h>

#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "convert.h"

namespace camber::python {
namespace {

std::string text_of(const Eigen::Vector3d& v) {
  return fmt::format("({:.4g}, {:.4g}, {:.4g})", v.x(), v.y(), v.z());
}

void bind_planes(py::module_& module) {
  py::class_<Plane>(module, "Plane", kDoc_Plane)
      .def(py::init([](const Eigen::Vector3d& normal, double offset) {
             const double length = normal.norm();
             if (!(length > 0.0) || !std::isfinite(length)) {
               throw std::invalid_argument("normal: expected three finite numbers, not all 0");
             }
             if (!std::isfinite(offset)) {
               throw std::invalid_argument("offset: expected a finite number");
             }
             return Plane{normal / length, offset / length};
           }),
           py::arg("normal"), py::arg("offset"), "n . x + d = 0; scaled to a unit normal.")
      .CAMBER_FIELD(Plane, normal)
      .CAMBER_FIELD(Plane, offset)
      .def("signed_distance", &Plane::signed_distance, py::arg("point"), kDoc_Plane_signed_distance)
      .def("foot", &Plane::foot, py::arg("point"), kDoc_Plane_foot)
      .def("__repr__", [](const Plane& plane) {
        return fmt::format("<camber.Plane normal {}, offset {:.4g}>", text_of(plane.normal),
                           plane.offset);
      });
  py::class_<UncertainPlane>(module, "UncertainPlane", kDoc_UncertainPlane)
      .CAMBER_FIELD(UncertainPlane, plane)
      .CAMBER_FIELD(UncertainPlane, centroid)
      .CAMBER_FIELD(UncertainPlane, axis1)
      .CAMBER_FIELD(UncertainPlane, axis2)
      .CAMBER_FIELD(UncertainPlane, covariance)
      .def("height_variance", &UncertainPlane::height_variance, py::arg("point"),
           kDoc_UncertainPlane_height_variance)
      .def("__repr__", [](const UncertainPlane& plane) {
        return fmt::format("<camber.UncertainPlane normal {} at {}, height +- {:.2g}>",
                           text_of(plane.plane.normal), text_of(plane.centroid),
                           std::sqrt(plane.covariance(2, 2)));
      });
}

void bind_boxes(py::module_& module) {
  py::class_<Box2>(module, "Box2", kDoc_Box2)
      .def(py::init([](double x1, double y1, double x2, double y2) {
             return Box2{x1, y1, x2, y2};
           }),
           py::arg("x1"), py::arg("y1"), py::arg("x2"), py::arg("y2"))
      .def_readonly("x1", &Box2::x1, "px")
      .def_readonly("y1", &Box2::y1, "px")
      .def_readonly("x2", &Box2::x2, "px")
      .def_readonly("y2", &Box2::y2, "px")
      .def("__repr__", [](const Box2& box) {
        return fmt::format("<camber.Box2 {:.1f}, {:.1f} to {:.1f}, {:.1f} px>", box.x1, box.y1,
                           box.x2, box.y2);
      });
  py::class_<Dimensions>(module, "Dimensions", kDoc_Dimensions)
      .def_readonly("length", &Dimensions::length, "m")
      .def_readonly("width", &Dimensions::width, "m")
      .def_readonly("height", &Dimensions::height, "m")
      .def("__repr__", [](const Dimensions& size) {
        return fmt::format("<camber.Dimensions {:.2f} x {:.2f} x {:.2f} m>", size.length,
                           size.width, size.height);
      });
  py::class_<OrientedBox>(module, "OrientedBox", kDoc_OrientedBox)
      .def_property_readonly(
          "camera_from_vehicle",
          [](const OrientedBox& box) { return to_matrix(box.camera_from_vehicle); },
          "4 x 4: takes points of the vehicle to the camera")
      .CAMBER_FIELD(OrientedBox, dimensions)
      .def_property_readonly("bottom_center", &OrientedBox::bottom_center,
                             "middle of the bottom face, camera frame, m")
      .def_property_readonly("center", &OrientedBox::center, "middle of the box, camera frame, m")
      .def_property_readonly(
          "rotation_y",
          [](const OrientedBox& box) {
            return rotation_y(box.camera_from_vehicle.rotation_matrix());
          },
          kDoc_rotation_y)
      .def(
          "corners",
          [](const OrientedBox& box) -> Eigen::Matrix<double, 8, 3> {
            return box.corners().transpose();
          },
          kDoc_OrientedBox_corners)
      .def("__repr__", [](const OrientedBox& box) {
        return fmt::format("<camber.OrientedBox centre {}, {:.2f} x {:.2f} x {:.2f} m>",
                           text_of(box.center()), box.dimensions.length, box.dimensions.width,
                           box.dimensions.height);
      });
}

}  // namespace

void bind_geometry(py::module_& module) {
  py::class_<PinholeCamera>(module, "PinholeCamera", kDoc_PinholeCamera)
      .def(py::init([](int width, int height, double fx, double fy, double cx, double cy) {
             const PinholeCamera camera{width, height, fx, fy, cx, cy};
             camera.validate();
             return camera;
           }),
           py::arg("width"), py::arg("height"), py::arg("fx"), py::arg("fy"), py::arg("cx"),
           py::arg("cy"), "All in pixels.")
      .CAMBER_FIELD(PinholeCamera, width)
      .CAMBER_FIELD(PinholeCamera, height)
      .CAMBER_FIELD(PinholeCamera, fx)
      .CAMBER_FIELD(PinholeCamera, fy)
      .CAMBER_FIELD(PinholeCamera, cx)
      .CAMBER_FIELD(PinholeCamera, cy)
      .def("matrix", &PinholeCamera::matrix, "3 x 3, of the intrinsic parameters")
      .def("project", &PinholeCamera::project, py::arg("point"), kDoc_PinholeCamera_project)
      .def("__repr__", [](const PinholeCamera& camera) {
        return fmt::format(
            "<camber.PinholeCamera {} x {}, fx {:.2f}, fy {:.2f}, cx {:.2f}, cy {:.2f}>",
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy);
      });
  bind_planes(module);
  bind_boxes(module);
}

}  // namespace camber::python
