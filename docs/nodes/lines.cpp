// Prints a ball and an arm at rest, one JSON object a line, for a monitor without sockets:
//   g++ -std=c++17 lines.cpp -o lines && ./lines 10 | armguard run demos/cell.toml --obstacles -
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

int main(int count, char** arguments) {
  const double duration = count > 1 ? std::atof(arguments[1]) : 10.0;  // [s]
  auto tick = std::chrono::steady_clock::now();  // CLOCK_MONOTONIC on Linux
  for (int sequence = 1; sequence <= 500 * duration; ++sequence) {
    const double stamp = std::chrono::duration<double>(tick.time_since_epoch()).count();  // [s]
    if (sequence % 5 == 1)
      std::printf(R"({"type": "obstacles", "source": "camera", "seq": %d, "stamp": %.9f, )"
                  R"("ids": ["ball"], "position": [[3, 0.3, 0.5]], "radius": 0.1})" "\n",
                  sequence / 5 + 1, stamp);
    std::printf(R"({"type": "joints", "seq": %d, "stamp": %.9f, )"
                R"("names": ["panda_joint1", "panda_joint2", "panda_joint3", "panda_joint4", )"
                R"("panda_joint5", "panda_joint6", "panda_joint7"], )"
                R"("q": [0, -0.785, 0, -2.356, 0, 1.571, 0.785], "v": [0, 0, 0, 0, 0, 0, 0]})" "\n",
                sequence, stamp);
    std::fflush(stdout);  // whole lines, in time
    std::this_thread::sleep_until(tick += std::chrono::milliseconds(2));
  }
}
