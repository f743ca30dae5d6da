// What is beside the 3D scene: the image, the colour bar, the help, snapshots.

#include "detail/viewer_state.h"

namespace camber {

QPixmap to_pixmap(const Image& image) {
  const QImage wrapped(image.data.data(), image.width, image.height, 3 * image.width,
                       QImage::Format_RGB888);
  return QPixmap::fromImage(wrapped);  // copies
}

QString text(const char* format, ...) {
  va_list values;
  va_start(values, format);
  const QString out = QString::vasprintf(format, values);
  va_end(values);
  return out;
}

void ViewerWindow::Impl::show_message(const std::string& message) {
  window->statusBar()->showMessage(from(message));
}

void ViewerWindow::Impl::show_summary() {
  frame_label->setText(text("frame %d", content.frame));
  frame_label->setVisible(!frames.empty());
  frame_slider->setVisible(!frames.empty());
  show_message(content_summary(content, space));
}

void ViewerWindow::Impl::load_image() {
  photo = QPixmap();
  if (!result.scene) {
    image->setText(frames.empty() ? "" : "no images: start with --scene");
    image->setVisible(!frames.empty());
    return;
  }
  try {
    OverlayOptions overlay;
    overlay.show_grade = grade && result.surface.has_value();
    overlay.show_ellipses = ellipses;
    photo = to_pixmap(draw_frame_overlay(result, content.frame, overlay));
    fit_image();
  } catch (const Error& error) {
    image->setText(from(error.what()));
  }
}

void ViewerWindow::Impl::fit_image() {
  if (photo.isNull()) return;
  image->setPixmap(photo.scaled(image->size(), Qt::KeepAspectRatio, Qt::SmoothTransformation));
}

void ViewerWindow::Impl::draw_bar() {
  bar->setVisible(space.has_color_bar);
  if (!space.has_color_bar) return;
  constexpr double kText = 16.0;
  double width = 7.0 * kText;
  for (const std::string& line : space.color_title) {
    width = std::max(width, Canvas::text_size(line, kText).x() + 1.2 * kText);
  }
  const double top = 1.2 * kText * static_cast<double>(space.color_title.size()) + 0.4 * kText;
  Image picture = make_picture(static_cast<int>(width), static_cast<int>(top + 13.0 * kText), 255);
  Canvas canvas(picture);
  draw_color_bar(canvas, {0.6 * kText, top, 1.7 * kText, top + 12.4 * kText}, space.color_range.low,
                 space.color_range.high, space.color_title, kText, kInk, space.color_scale);
  bar->setPixmap(to_pixmap(picture));
  bar->adjustSize();
  place_overlays();
}

void ViewerWindow::Impl::place_overlays() {
  bar->move(view->width() - bar->width() - 10, 10);
  help->adjustSize();
  help->move((view->width() - help->width()) / 2, (view->height() - help->height()) / 2);
}

QString ViewerWindow::Impl::help_text() {
  QString out = "<table cellspacing='4'>";
  const auto row = [&](const QString& key, const QString& what) {
    out += "<tr><td><b>" + key + "</b>&nbsp;&nbsp;</td><td>" + what + "</td></tr>";
  };
  row("click", "facts about a point, patch or vehicle");
  row("drag", "turn; with the middle button: move; wheel or right button: nearer, farther");
  for (const SceneSwitch& entry : scene_switches()) {
    row(key_of(entry.element), QString(entry.text) + " on, off");
  }
  row("m", "next colours of the points");
  row("+ &minus;", "larger, smaller points");
  row("&larr; &rarr;", "frame before, after");
  row("1 2 3 4", "oblique, side, from above, driver's view");
  row("i", "grade of the road in the image");
  row("u", "uncertainty of the vehicles' positions (1 sigma) in the image");
  row("s", "picture of the scene into a file; S: of the window");
  row("h", "this help");
  row("q", "quit");
  return out + "</table>";
}

void ViewerWindow::Impl::save_next(bool whole_window) {
  std::filesystem::path path;
  std::error_code error;
  for (int i = 1;; ++i) {
    path = options.snapshots + "-" + std::to_string(i) + ".png";
    if (!std::filesystem::exists(path, error)) break;
  }
  try {
    save(path, whole_window);
    show_message("wrote " + path.string());
  } catch (const Error& failure) {
    show_message(failure.what());
  }
}

void ViewerWindow::Impl::save(const std::filesystem::path& path, bool whole_window) {
  render();
  QImage picture = view->grabFramebuffer();
  if (whole_window) {
    picture = window->grab().toImage();
  } else if (bar->isVisible()) {
    QPainter painter(&picture);
    painter.drawPixmap(bar->pos(), bar->pixmap(Qt::ReturnByValue));
  }
  QByteArray bytes;
  QBuffer buffer(&bytes);
  buffer.open(QIODevice::WriteOnly);
  if (!picture.convertToFormat(QImage::Format_RGB888).save(&buffer, "PNG")) {
    throw MachineError("the picture of the window cannot be encoded");
  }
  write_file_atomically(path, bytes.toStdString());
  written.push_back(path);
}

}  // namespace camber
