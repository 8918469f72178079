#include "drawing.hpp"

#include <algorithm>

#include "picture.hpp"

namespace simulator {
namespace {

constexpr double SCALE = 180, FLOOR = 284;  // px per unit; the row of the floor
constexpr double BAT = 5;                   // half its height, px

constexpr Colour NIGHT = {14, 16, 34}, DUSK = {34, 30, 66}, WALL = {86, 92, 150}, COURT = {22, 26, 52};
constexpr Colour WARM = {255, 216, 110}, HOT = {255, 104, 62}, WHITE = {255, 255, 255}, DANGER = {220, 60, 84};
constexpr Colour READY = {120, 214, 255}, TIRED = {70, 84, 128};

double across(double x) { return WIDTH / 2.0 + SCALE * x; }
double down(double y) { return FLOOR - SCALE * y; }

void paint_court(Picture& picture) {
  const double middle = down(COURT_HEIGHT / 2), half = SCALE * COURT_HEIGHT / 2;
  picture.box(across(0), middle, SCALE + 4, half + 4, 10, WALL);
  picture.box(across(0), middle, SCALE, half, 7, COURT);
  picture.box(across(0), middle, SCALE, half, 7, WALL, 0.22, 160);  // darker towards the walls
  picture.box(across(0), middle, SCALE, 1, 0, WALL, 0.4);
  picture.disc(across(0), middle, 44, WALL, 0.4);
  picture.disc(across(0), middle, 42, COURT, 0.8);
  picture.box(across(0), FLOOR - 1, SCALE - 8, 1, 1, DANGER, 0.9);
  picture.box(across(0), FLOOR, SCALE - 20, 2, 2, DANGER, 0.5, 20);
}

/// Paints a light per return, gold for smashes.
void paint_score(Picture& picture, const Court& court) {
  for (int light = 0; light < court.returns; ++light) {
    picture.disc(across(-1) + 6 + 12 * light, 15, 3.5, light < court.smashes ? WARM : WALL);
  }
}

void paint_ball(Picture& picture, const Court& court) {
  const double square = court.velocity_x * court.velocity_x + court.velocity_y * court.velocity_y;
  const double smash = SMASH * BALL_SPEED * court.pace;
  const Colour color = square < 0.9 * smash * smash ? WARM : HOT;
  const double x = across(court.x), y = down(court.y), radius = SCALE * BALL_RADIUS;
  for (int back = 12; back > 0; --back) {  // a tail, narrower and paler towards its end
    const double seconds = 0.01 * back;
    picture.disc(x - SCALE * seconds * court.velocity_x, y + SCALE * seconds * court.velocity_y,
                 radius * (1 - 0.06 * back), color, 0.2 - 0.015 * back, 5);
  }
  picture.disc(x, y, radius, color, 0.5, 36);
  picture.disc(x, y, radius, color);
  picture.disc(x - 2.5, y - 2.5, 2.5, WHITE, 0.7, 2);
}

void paint_bat(Picture& picture, const Court& court, double half_bat) {
  const double x = across(court.bat), y = down(BAT_TOP) + BAT, half = SCALE * half_bat;
  if (court.swinging()) {
    picture.box(x, y - 3, half, BAT, BAT, HOT, 0.9, 28);
    picture.box(x, y - 3, half, BAT, BAT, WHITE);
    return;
  }
  picture.box(x, y, half, BAT, BAT, court.wait == 0 ? READY : TIRED);
  if (court.wait > 0) {  // what has recovered so far, from the middle
    const double share = 1 - double(court.wait) / RECOVERY;
    picture.box(x, y, std::max(BAT - 1, half * share), BAT - 2, BAT - 2, READY, 0.45);
  }
}

}  // namespace

std::string draw(const Court& court, double half_bat) {
  Picture picture(WIDTH, HEIGHT, NIGHT, DUSK);
  paint_court(picture);
  paint_score(picture, court);
  paint_bat(picture, court, half_bat);
  paint_ball(picture, court);
  return picture.bytes();
}

}  // namespace simulator
