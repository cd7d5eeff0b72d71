#include "session.h"

#include <string.h>

#define FIRST_HOST_NUMBER 32u /* numbers below come from a device */

typedef enum {
    ON_HOLD,
    ON_STREAM,
    ON_RELEASE,
    ON_STOP,
    ON_CLEAR_LATCHED, /* CLEAR_FAULT while the latch holds */
    ON_CLEAR_OPEN,    /* CLEAR_FAULT while the latch is open */
    ON_LEASE_LOST,
    ON_FAULT
} trigger_t;

typedef struct {
    uint8_t state;
    trigger_t trigger;
    uint8_t target;
} transition_t;

/* Transitions that are not in this table are refused. Only RELEASE leads from a latched to an open state. */
static const transition_t TRANSITIONS[] = {
    {DPR_IDLE, ON_HOLD, DPR_HOLDING},
    {DPR_IDLE, ON_STOP, DPR_IDLE},
    {DPR_HOLDING, ON_HOLD, DPR_HOLDING},
    {DPR_HOLDING, ON_STREAM, DPR_STREAMING},
    {DPR_HOLDING, ON_STOP, DPR_HOLDING},
    {DPR_STREAMING, ON_RELEASE, DPR_RELEASED},
    {DPR_STREAMING, ON_STOP, DPR_HOLDING},
    {DPR_STREAMING, ON_LEASE_LOST, DPR_HOLDING},
    {DPR_RELEASED, ON_STOP, DPR_IDLE},
    {DPR_RELEASED, ON_LEASE_LOST, DPR_IDLE},
    {DPR_FAULT, ON_CLEAR_LATCHED, DPR_HOLDING},
    {DPR_FAULT, ON_CLEAR_OPEN, DPR_IDLE},
    {DPR_FAULT, ON_STOP, DPR_FAULT},
    {DPR_IDLE, ON_FAULT, DPR_FAULT},
    {DPR_HOLDING, ON_FAULT, DPR_FAULT},
    {DPR_STREAMING, ON_FAULT, DPR_FAULT},
    {DPR_RELEASED, ON_FAULT, DPR_FAULT},
    {DPR_FAULT, ON_FAULT, DPR_FAULT},
};

/* Received command; its number determines which fields are used. */
typedef struct {
    uint8_t number, token, pose;
    uint16_t rate_hz;
    struct dpr_hello_t hello;
} command_t;

static const transition_t *find(const dpr_session_t *session, trigger_t trigger)
{
    for (size_t i = 0; i < sizeof TRANSITIONS / sizeof TRANSITIONS[0]; i++) {
        if (TRANSITIONS[i].state == session->state && TRANSITIONS[i].trigger == trigger) {
            return &TRANSITIONS[i];
        }
    }
    return NULL;
}

static bool move(dpr_session_t *session, trigger_t trigger)
{
    const transition_t *transition = find(session, trigger);
    if (transition == NULL) {
        return false;
    }
    session->state = transition->target;
    if (session->state != DPR_FAULT) { /* a fault does not change the latch */
        session->latched = session->state == DPR_HOLDING || session->state == DPR_STREAMING;
        session->fault = DPR_STATUS_FAULT_NONE_CHOICE;
    }
    return true;
}

static trigger_t trigger_of(const dpr_session_t *session, uint8_t number)
{
    switch (number) {
    case DPR_HOLD_FRAME_ID:
        return ON_HOLD;
    case DPR_STREAM_FRAME_ID:
        return ON_STREAM;
    case DPR_RELEASE_FRAME_ID:
        return ON_RELEASE;
    case DPR_CLEAR_FAULT_FRAME_ID:
        return session->latched ? ON_CLEAR_LATCHED : ON_CLEAR_OPEN;
    default:
        return ON_STOP;
    }
}

/* Read a message with exactly the bytes that dpr.dbc defines and values in range; otherwise return a NAK code. */
static uint8_t parse(const dpr_frame_t *frame, command_t *command)
{
    struct dpr_hold_t hold;
    struct dpr_release_t release;
    struct dpr_stream_t stream;
    size_t length = frame->length;
    bool good = false;
    command->number = (uint8_t)(frame->id & DPR_NUMBER_MASK);
    command->token = length > 0 ? frame->data[0] : 0;
    switch (command->number) {
    case DPR_HELLO_FRAME_ID:
        good = length == DPR_HELLO_LENGTH && dpr_hello_unpack(&command->hello, frame->data, length) == 0;
        break;
    case DPR_HOLD_FRAME_ID:
        good = length == DPR_HOLD_LENGTH && dpr_hold_unpack(&hold, frame->data, length) == 0;
        command->pose = good ? hold.pose : 0;
        break;
    case DPR_RELEASE_FRAME_ID:
        good = length == DPR_RELEASE_LENGTH && dpr_release_unpack(&release, frame->data, length) == 0
               && dpr_release_key_is_in_range(release.key);
        break;
    case DPR_STREAM_FRAME_ID:
        good = length == DPR_STREAM_LENGTH && dpr_stream_unpack(&stream, frame->data, length) == 0
               && dpr_stream_rate_hz_is_in_range(stream.rate_hz);
        command->rate_hz = good ? stream.rate_hz : 0;
        break;
    case DPR_STOP_FRAME_ID:
        good = length == DPR_STOP_LENGTH;
        break;
    case DPR_CLEAR_FAULT_FRAME_ID:
        good = length == DPR_CLEAR_FAULT_LENGTH;
        break;
    default:
        return DPR_NAK_CODE_UNKNOWN_COMMAND_CHOICE;
    }
    return good ? 0 : DPR_NAK_CODE_BAD_VALUE_CHOICE;
}

static void add(dpr_answer_t *answer, dpr_frame_t frame)
{
    answer->frames[answer->count++] = frame;
}

static void add_verdict(const dpr_session_t *session, const dpr_verdict_t *verdict, dpr_answer_t *answer)
{
    uint8_t node = session->identity->node;
    add(answer, verdict->refusal ? dpr_nak(node, verdict->command, verdict->token, verdict->refusal)
                                 : dpr_ack(node, verdict->command, verdict->token));
}

static uint8_t hello_refusal(const struct dpr_hello_t *hello)
{
    if (hello->major != DPR_PROTOCOL_MAJOR) {
        return DPR_NAK_CODE_VERSION_CHOICE;
    }
    if (hello->minor == DPR_PROTOCOL_MINOR && hello->schema_hash != DPR_SCHEMA_HASH) {
        return DPR_NAK_CODE_SCHEMA_CHOICE;
    }
    return 0;
}

/* Begin a new session: answers of the previous session are not repeated. */
static void greet(dpr_session_t *session, const command_t *hello, dpr_answer_t *answer)
{
    dpr_verdict_t verdict = {hello->number, hello->token, hello_refusal(&hello->hello)};
    session->remembered = 0;
    session->oldest = 0;
    session->greeted = verdict.refusal == 0;
    add_verdict(session, &verdict, answer);
    if (session->identity->torques[0] || session->identity->torques[1]) {
        add(answer, dpr_info(session->identity, DPR_INFO_PAGE_TORQUES_CHOICE));
    }
    if (session->identity->inputs[0] || session->identity->inputs[1]) {
        add(answer, dpr_info(session->identity, DPR_INFO_PAGE_ARM_INPUT_CHOICE));
    }
    for (uint8_t page = 0; page < DPR_INFO_PAGES; page++) {
        add(answer, dpr_info(session->identity, page));
    }
}

static uint8_t refusal_of(const dpr_session_t *session, const command_t *command)
{
    if (!session->greeted) {
        return DPR_NAK_CODE_NOT_GREETED_CHOICE;
    }
    if (find(session, trigger_of(session, command->number)) == NULL) {
        return session->state == DPR_FAULT ? DPR_NAK_CODE_FAULTED_CHOICE : DPR_NAK_CODE_WRONG_STATE_CHOICE;
    }
    if (command->number == DPR_STREAM_FRAME_ID && command->rate_hz > session->identity->rate_max_hz) {
        return DPR_NAK_CODE_RATE_TOO_HIGH_CHOICE;
    }
    return 0;
}

static const dpr_verdict_t *recall(const dpr_session_t *session, const command_t *command)
{
    for (size_t i = 0; i < session->remembered; i++) {
        if (session->verdicts[i].command == command->number && session->verdicts[i].token == command->token) {
            return &session->verdicts[i];
        }
    }
    return NULL;
}

static void remember(dpr_session_t *session, const dpr_verdict_t *verdict)
{
    if (session->remembered < DPR_REMEMBERED) {
        session->verdicts[session->remembered++] = *verdict;
        return;
    }
    session->verdicts[session->oldest] = *verdict;
    session->oldest = (uint8_t)((session->oldest + 1u) % DPR_REMEMBERED);
}

static void set_task(const command_t *command, dpr_answer_t *answer)
{
    switch (command->number) {
    case DPR_HOLD_FRAME_ID:
        answer->task = DPR_DO_HOLD;
        answer->pose = command->pose;
        break;
    case DPR_STREAM_FRAME_ID:
        answer->task = DPR_DO_STREAM;
        answer->rate_hz = command->rate_hz;
        break;
    case DPR_RELEASE_FRAME_ID:
        answer->task = DPR_DO_RELEASE;
        break;
    case DPR_STOP_FRAME_ID:
        answer->task = DPR_DO_STOP;
        break;
    default: /* CLEAR_FAULT: if the fault persists, the hardware reports it again */
        break;
    }
}

/* Carry out a command once, even if it is received several times. */
static void obey(dpr_session_t *session, const command_t *command, dpr_answer_t *answer)
{
    const dpr_verdict_t *known = recall(session, command);
    if (known != NULL) {
        add_verdict(session, known, answer);
        return;
    }
    dpr_verdict_t verdict = {command->number, command->token, refusal_of(session, command)};
    remember(session, &verdict);
    add_verdict(session, &verdict, answer);
    if (verdict.refusal == 0) {
        move(session, trigger_of(session, command->number));
        set_task(command, answer);
    }
}

/* Process PING and KEEPALIVE, which are never refused. */
static bool receive_sign_of_life(
    dpr_session_t *session, const dpr_frame_t *frame, uint32_t now_ms, dpr_answer_t *answer)
{
    uint8_t number = (uint8_t)(frame->id & DPR_NUMBER_MASK);
    bool ping = number == DPR_PING_FRAME_ID;
    if (!ping && number != DPR_KEEPALIVE_FRAME_ID) {
        return false;
    }
    if (frame->length == (ping ? DPR_PING_LENGTH : DPR_KEEPALIVE_LENGTH)) {
        session->heard_ms = now_ms;
        answer->task = ping ? DPR_DO_PONG : DPR_DO_NOTHING;
        answer->ping = (uint16_t)(frame->data[0] | (uint16_t)(frame->data[1] << 8));
    }
    return true;
}

void dpr_session_start(dpr_session_t *session, const dpr_identity_t *identity)
{
    memset(session, 0, sizeof *session);
    session->identity = identity;
}

bool dpr_session_streams(const dpr_session_t *session)
{
    return session->state == DPR_STREAMING || session->state == DPR_RELEASED;
}

void dpr_session_receive(dpr_session_t *session, const dpr_frame_t *frame, uint32_t now_ms, dpr_answer_t *answer)
{
    command_t command = {0};
    answer->count = 0;
    answer->task = DPR_DO_NOTHING;
    if (frame->id >> 6 != session->identity->node || (frame->id & DPR_NUMBER_MASK) < FIRST_HOST_NUMBER
        || receive_sign_of_life(session, frame, now_ms, answer)) {
        return;
    }
    uint8_t refusal = parse(frame, &command);
    if (refusal != 0) {
        dpr_verdict_t verdict = {command.number, command.token, refusal};
        add_verdict(session, &verdict, answer);
        return;
    }
    session->heard_ms = now_ms;
    if (command.number == DPR_HELLO_FRAME_ID) {
        greet(session, &command, answer);
    } else {
        obey(session, &command, answer);
    }
}

void dpr_session_check_lease(dpr_session_t *session, uint32_t now_ms, uint32_t tick, dpr_answer_t *answer)
{
    answer->count = 0;
    answer->task = DPR_DO_NOTHING;
    if (now_ms - session->heard_ms < DPR_LEASE_MS || !move(session, ON_LEASE_LOST)) {
        return;
    }
    add(answer, dpr_event(session->identity->node, DPR_EVENT_KIND_LEASE_LOST_CHOICE, 0, tick));
    answer->task = DPR_DO_STOP;
}

void dpr_session_fault(dpr_session_t *session, uint8_t fault, uint32_t tick, dpr_answer_t *answer)
{
    answer->count = 0;
    session->fault = fault;
    move(session, ON_FAULT);
    add(answer, dpr_event(session->identity->node, DPR_EVENT_KIND_FAULT_CHOICE, fault, tick));
    answer->task = DPR_DO_STOP;
}
