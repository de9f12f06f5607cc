/* Controller of a tractor in C, over UDP: Stanley's law about the reference of the plant.
 *
 *   cc -O2 -o udp_controller udp_controller.c -lm
 *   ttempc serve grass &
 *   ./udp_controller 8890
 *
 * The steering follows Hoffmann, Tomlin, Montemerlo and Thrun, "Autonomous Automobile Trajectory
 * Tracking for Off-Road Driving" (ACC 2007): the heading error and the cross-track error of the front
 * axle, added to the steering of the reference. Gains are assumed. The trailer is steered as the
 * reference is. A datagram that is lost is asked for by sending the last one again.
 */
#include <arpa/inet.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define CROSS_GAIN 1.0 /* of the cross-track error, 1/s */
#define ALONG_GAIN 0.5 /* of the along-track error, 1/s */
#define SPEED_GAIN 0.5 /* of the speed error, in hydrostat position per m/s */
#define TRIES 30       /* of half a second each, without an answer */
#define FIRST_TRIES 600 /* the same before the first answer */

/* Return the number behind "key": after a place in a message, NAN where there is none. */
static double number(const char *place, const char *key) {
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    const char *found = place ? strstr(place, quoted) : NULL;
    if (!found) return NAN;
    char *end;
    double value = strtod(found + strlen(quoted), &end);
    return end == found + strlen(quoted) ? NAN : value;
}

int main(int count, char **arguments) {
    static char message[65536];
    char answer[256] =
        "{\"type\":\"hello\",\"version\":1,\"name\":\"stanley.c\",\"reference\":1,\"estimate\":true}";
    struct sockaddr_in plant = {.sin_family = AF_INET};
    struct timeval patience = {.tv_usec = 500000};
    double wheelbase = NAN;
    int unanswered = 0, commands = 0, welcome = 0;

    plant.sin_port = htons((unsigned short)(count > 1 ? atoi(arguments[1]) : 8890));
    inet_pton(AF_INET, count > 2 ? arguments[2] : "127.0.0.1", &plant.sin_addr);
    int link = socket(AF_INET, SOCK_DGRAM, 0);
    setsockopt(link, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    if (connect(link, (struct sockaddr *)&plant, sizeof plant) < 0) return 1;

    send(link, answer, strlen(answer), 0);
    while (unanswered < (welcome ? TRIES : FIRST_TRIES)) {
        ssize_t size = recv(link, message, sizeof message - 1, 0);
        if (size < 0) { /* nothing came, or nobody listens yet */
            unanswered++;
            usleep(100000); /* a port that is closed answers at once */
            send(link, answer, strlen(answer), 0);
            continue;
        }
        message[size] = '\0';
        unanswered = 0;
        if (strstr(message, "\"type\":\"end\"")) {
            printf("%d commands, %s\n", commands, strstr(message, "\"status\""));
            return 0;
        }
        if (strstr(message, "\"type\":\"welcome\"")) {
            wheelbase = number(message, "wheelbase");
            welcome = 1;
        }
        if (!strstr(message, "\"type\":\"samples\"")) continue;

        const char *at = strstr(message, "\"estimate\":"), *to = strstr(message, "\"reference\":");
        double x = number(at, "x_m") - number(to, "x_m");
        double y = number(at, "y_m") - number(to, "y_m");
        double heading = number(to, "yaw_rad"), speed = number(at, "speed_mps");
        double along = x * cos(heading) + y * sin(heading);
        double left = y * cos(heading) - x * sin(heading);
        double turned = number(at, "yaw_rad") - heading;
        turned = atan2(sin(turned), cos(turned));
        double front = left + wheelbase * sin(turned);
        double steering =
            number(to, "delta_t_rad") - turned - atan2(CROSS_GAIN * front, fmax(fabs(speed), 0.3));
        double wanted = number(to, "speed_mps") - ALONG_GAIN * along;
        double hydrostat = number(to, "hp") + SPEED_GAIN * (wanted - speed);

        if (!isfinite(steering) || !isfinite(hydrostat)) continue; /* no estimate: no command */
        snprintf(answer, sizeof answer,
                 "{\"type\":\"command\",\"tick\":%.0f,\"delta_t_rad\":%.17g,\"delta_i_rad\":%.17g,"
                 "\"hp\":%.17g}",
                 number(message, "tick"), steering, number(to, "delta_i_rad"), hydrostat);
        send(link, answer, strlen(answer), 0);
        commands++;
    }
    fprintf(stderr, "no answer from the plant\n");
    return 1;
}
