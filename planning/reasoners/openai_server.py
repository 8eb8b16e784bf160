"""Language models behind a server that speaks the OpenAI chat protocol: hosted ones, vLLM, ollama, transformers serve.

What servers differ in is found out once and kept for the run: a server that refuses (status 400 or 422) or ignores a
schema for answers gets none, one that refuses pictures gets none (the measured facts are in every prompt), one that
names the length limit or the temperature otherwise gets it so. Every such change is logged, and so is every request
that is made again.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from control.errors import ReasonerError
from planning.language.answers import MalformedAnswerError, UnusableAnswerError
from planning.reasoners.chat_texts import as_data_url, chat_messages, without_thinking
from planning.reasoners.reasoner import AnswerUsage, Log
from planning.reasoners.server_options import EXAMPLE_URLS, ServerOptions
from planning.reasoners.structured_answers import as_answer, object_hint, response_format
from prompts.contracts import contract as contract_of
from replan_base.parts import install_part

if TYPE_CHECKING:
    from openai.types.chat import ChatCompletion

LONGEST_WAIT = 30.0  # [s] before a request is made again, whatever the server asks for
# Words by which servers say what they refuse; each stands for one thing that can be left out or said otherwise.
_REFUSED = {
    "schema": ("response_format", "json_schema", "structured", "guided", "grammar", "json mode"),
    "pictures": ("image", "picture", "vision", "multimodal", "multi-modal", "content type", "content must be a string"),
    "length": ("max_tokens",),
    "temperature": ("temperature",),
}


class OpenAIReasoner:
    """Asks one model of one server.

    Args:
        options: Which one, and bounds.
        key: Sent to the server and nowhere else; None where the server wants none.
        log: Gets `server_request` for every request that failed and `server_difference` for what it turned out to want.
        sleep: Waits so many seconds.

    Raises:
        ReasonerError: The package `openai` is not installed.
    """

    def __init__(
        self, options: ServerOptions, key: str | None, log: Log, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        try:
            import openai
        except ImportError:
            raise ReasonerError(
                "language servers need the package 'openai', which is not installed; install it with: "
                + install_part("models")
            ) from None
        self._openai = openai
        self.options = options
        self._key = key
        self._log = log
        self._sleep = sleep
        # The one policy of trying again is here, where it is logged.
        self._client = openai.OpenAI(
            base_url=options.url, api_key=key or "none", timeout=options.timeout, max_retries=0
        )
        self._left_out: set[str] = set() if options.schema else {"schema"}
        self._usage = AnswerUsage()

    @property
    def name(self) -> str:
        """For reports."""
        return f"{self.options.model} at {self.options.url}"

    @property
    def usage(self) -> AnswerUsage:
        """See `planning.reasoners.reasoner.Metered`."""
        return self._usage

    def check(self) -> None:
        """One short question, so that a wrong address, key or model is known before anything moves.

        Raises:
            ReasonerError: The server cannot answer; says why and what to do.
        """
        self._usage = AnswerUsage()
        started = time.monotonic()
        messages = [{"role": "user", "content": "Reply with the single word yes."}]
        self._complete({"messages": messages, "limit": 16})
        self._log("server_checked", reasoner=self.name, seconds=round(time.monotonic() - started, 3))

    def models(self) -> list[str]:
        """Names of the models that the server lists; none from a server that keeps no list.

        Raises:
            ReasonerError: No server there, or it refuses the key.
        """
        try:
            return self._list_models()
        except self._openai.APIStatusError as error:
            if error.status_code in (401, 403):
                raise self._explained(error, 1) from None
            return []
        except self._openai.APIConnectionError as error:
            raise self._explained(error, 1) from None
        except (self._openai.OpenAIError, ValueError, AttributeError, TypeError):
            return []

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`; the fields are not used.

        Raises:
            UnusableAnswerError: The answer was cut off, withheld, or is an object of another form.
            ReasonerError: The server cannot answer; says why and what to do.
        """
        self._usage = AnswerUsage()
        form = contract_of(contract).answer
        completion, schema_sent = self._complete(
            {"contract": contract, "prompt": prompt, "pictures": images, "form": form, "limit": self.options.max_tokens}
        )
        choice = completion.choices[0]
        text = without_thinking(choice.message.content or "")
        if choice.finish_reason == "length":
            raise UnusableAnswerError(
                f"the answer was cut off after {self._usage.tokens_out} tokens; answer more briefly", text
            )
        if choice.message.refusal or choice.finish_reason == "content_filter":
            raise UnusableAnswerError(
                f"the model withheld its answer ({choice.message.refusal or 'content filter'})", text
            )
        if not schema_sent:
            return text
        try:
            answer = as_answer(text, form)
        except MalformedAnswerError as error:
            raise UnusableAnswerError(str(error), text) from None
        if answer is None:
            self._leave_out("schema", "the server took the schema and answered without it")
            return text
        return answer

    # -- requests ----------------------------------------------------------------------------------------------------

    def _complete(self, question: Mapping[str, Any]) -> "tuple[ChatCompletion, bool]":
        """The server's answer, and whether a schema was sent for it."""
        attempt = 1
        while True:
            request = self._request(question)
            try:
                completion = self._client.chat.completions.create(**request)
            except (self._openai.OpenAIError, json.JSONDecodeError) as error:
                self._log("server_request", reasoner=self.name, attempt=attempt, fault=self._told(error))
                if self._adapt(error, request):
                    continue  # not a failure of the server: at most one more request for each difference
                if attempt >= self.options.tries or not self._worth_another(error):
                    raise self._explained(error, attempt) from None
                self._sleep(self._wait(error, attempt))
                attempt += 1
                continue
            self._count(completion)
            return self._checked(completion), "response_format" in request

    def _request(self, question: Mapping[str, Any]) -> dict[str, Any]:
        options, left_out = self.options, self._left_out
        request: dict[str, Any] = {"model": options.model}
        request["max_completion_tokens" if "length" in left_out else "max_tokens"] = question["limit"]
        if "temperature" not in left_out:
            request["temperature"] = 0.0
        if "messages" in question:
            return request | {"messages": question["messages"]}
        prompt = question["prompt"]
        if "schema" not in left_out:
            request["response_format"] = response_format(question["form"])
            prompt += object_hint(question["form"])
        pictures = () if "pictures" in left_out else question["pictures"]
        parts = [{"type": "image_url", "image_url": {"url": as_data_url(p, options.picture_size)}} for p in pictures]
        request["messages"] = chat_messages(question["contract"], prompt, parts)
        return request

    def _adapt(self, error: Exception, request: Mapping[str, Any]) -> bool:
        """Leave out what the server refuses, if that is what it says; whether another request can differ."""
        if not isinstance(error, self._openai.APIStatusError) or error.status_code not in (400, 422):
            return False
        said = self._told(error).lower()
        sent = {
            "schema": "response_format" in request,
            "pictures": isinstance(request["messages"][-1]["content"], list),
            "length": "max_tokens" in request,
            "temperature": "temperature" in request,
        }
        for thing, words in _REFUSED.items():
            if sent[thing] and any(word in said for word in words):
                self._leave_out(thing, said)
                return True
        # Some servers refuse without a word of what; a schema is what most of them do not know.
        if sent["schema"]:
            self._leave_out("schema", said)
            return True
        return False

    def _leave_out(self, thing: str, why: str) -> None:
        self._left_out.add(thing)
        self._log("server_difference", reasoner=self.name, without=thing, why=why)

    def _worth_another(self, error: Exception) -> bool:
        if isinstance(error, self._openai.APITimeoutError):
            return True
        if isinstance(error, self._openai.APIConnectionError):
            return not _nobody_there(error)
        if isinstance(error, self._openai.RateLimitError):
            return error.code != "insufficient_quota"
        return isinstance(error, self._openai.APIStatusError) and error.status_code >= 500

    def _wait(self, error: Exception, attempt: int) -> float:
        wait = self.options.wait * 2 ** (attempt - 1)
        if isinstance(error, self._openai.APIStatusError):
            asked = error.response.headers.get("retry-after", "")
            if asked.replace(".", "", 1).isdigit():
                wait = float(asked)
        return min(wait, LONGEST_WAIT)

    def _checked(self, completion: Any) -> "ChatCompletion":
        if not getattr(completion, "choices", None) or completion.choices[0].message is None:
            raise ReasonerError(
                f"{self.options.url} answers, but not in the OpenAI chat protocol; its address usually ends with /v1: "
                f"{EXAMPLE_URLS}"
            )
        return completion

    def _count(self, completion: Any) -> None:
        usage = getattr(completion, "usage", None)
        tokens_in = self._usage.tokens_in + (getattr(usage, "prompt_tokens", 0) or 0)
        tokens_out = self._usage.tokens_out + (getattr(usage, "completion_tokens", 0) or 0)
        cost = (tokens_in * self.options.price_in + tokens_out * self.options.price_out) / 1e6
        self._usage = AnswerUsage(tokens_in, tokens_out, cost)

    # -- faults in words ---------------------------------------------------------------------------------------------

    def _told(self, error: BaseException) -> str:
        """A fault as the server or the client tells it: one line, and never with the key in it."""
        if isinstance(error, self._openai.APIConnectionError) and error.__cause__ is not None:
            error = error.__cause__  # the client itself only says that there was an error
        text = str(error) or type(error).__name__
        if isinstance(error, self._openai.APIStatusError):
            # The client's own text leaves out what servers put elsewhere than in the protocol's `error.message`.
            body = error.body if isinstance(error.body, Mapping) else {}
            said = body.get("message") or body.get("detail") or error.response.text
            text = f"status {error.status_code}: {said}" if said else f"status {error.status_code}"
        text = " ".join(text.split())
        if self._key:
            text = text.replace(self._key, "(key)")
        return text[:300]

    def _explained(self, error: Exception, attempts: int) -> ReasonerError:
        """What a person needs to know and do."""
        o, told = self.options, self._told(error)
        again = f" in {attempts} tries" if attempts > 1 else ""
        if isinstance(error, self._openai.APITimeoutError):
            return ReasonerError(
                f"{self.name} did not answer within {o.timeout:g} s{again}; a large model may need longer: raise "
                "--reasoner-timeout, or look at the server"
            )
        if isinstance(error, self._openai.APIConnectionError):
            if _nobody_there(error):
                return ReasonerError(
                    f"no language server answers at {o.url} ({told.rstrip('.')}); start it, or name another with "
                    f"--{o.option}-url, for instance {EXAMPLE_URLS}"
                )
            return ReasonerError(f"the language server at {o.url} broke off{again} ({told}); look at its log")
        if not isinstance(error, self._openai.APIStatusError):
            return ReasonerError(f"{self.name} gave an answer that cannot be read ({told}); look at the server's log")
        status = error.status_code
        if status in (401, 403):
            what = (
                f"the key in {o.key_variable}" if self._key else f"a request without a key ({o.key_variable} is empty)"
            )
            return ReasonerError(
                f"the language server at {o.url} refused {what} ({status}); put a valid key there, or name another "
                "variable with --reasoner-key-variable"
            )
        if status == 404:
            return ReasonerError(
                f"the language server at {o.url} has no model '{o.model}', or nothing at that address ({told}); "
                f"{self._offered()}"
            )
        if status == 429:
            return ReasonerError(
                f"the language server at {o.url} takes no more requests{again} ({told}); wait, or use another server, "
                "model or key"
            )
        if status >= 500:
            return ReasonerError(f"the language server at {o.url} failed{again} ({told}); look at its log")
        return ReasonerError(
            f"the language server at {o.url} refused the request for '{o.model}' ({told}); {self._offered()}"
        )

    def _offered(self) -> str:
        """Which models the server names, for a message; it need not name any."""
        try:
            names = self._list_models()[:10]
        except (self._openai.OpenAIError, ValueError, AttributeError, TypeError):
            names = []
        there = f"it offers {', '.join(names)}; " if names else ""
        option = self.options.option
        return f"{there}name one that it has with --{option}-model, and the address with --{option}-url"

    def _list_models(self) -> list[str]:
        return [m.id for m in self._client.models.list(timeout=min(5.0, self.options.timeout)).data]


def _nobody_there(error: BaseException) -> bool:
    """Whether no connection came about at all, rather than one that broke off.

    Told by its class's name: the client's HTTP library is httpx in some versions and httpx2 in others.
    """
    return type(error.__cause__).__name__ == "ConnectError"
