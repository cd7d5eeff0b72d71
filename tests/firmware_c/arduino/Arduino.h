/* As much of the Arduino core as the sketch uses, on a computer: Serial is the pseudo terminal on stdin and stdout. */
#pragma once
#include <stddef.h>
#include <stdint.h>

enum { LOW, HIGH };
enum { INPUT, OUTPUT, INPUT_PULLUP };
enum { CHANGE = 1 };

void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t value);
int digitalRead(uint8_t pin);
int digitalPinToInterrupt(uint8_t pin);
void attachInterrupt(int interrupt, void (*function)(void), int mode);
void noInterrupts(void);
void interrupts(void);
unsigned long micros(void);
unsigned long millis(void);

struct SerialPort {
    void begin(unsigned long baud);
    int available(void);
    int read(void);
    int availableForWrite(void);
    size_t write(const uint8_t *data, size_t length);
};
extern SerialPort Serial;

void setup(void);
void loop(void);
